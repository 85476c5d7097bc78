"""The hand in 3-D: taxels coloured and raised by pressure, slip lights, slip vectors, and scales with units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.messages import LOST, NO_POSE, OK
from taxelflow.publish.view import shapes
from taxelflow.publish.view.arrows import Arrows
from taxelflow.publish.view.articulation import fingers_of
from taxelflow.publish.view.batch import add_batch, put
from taxelflow.publish.view.camera import Camera, View, clearest, fitted, picture_axes, view_of
from taxelflow.publish.view.charts import shown_unit
from taxelflow.publish.view.hand_links import HandLinks
from taxelflow.publish.view.legend import Legend, Scales
from taxelflow.publish.view.lighting import add_lights, as_lit, lit
from taxelflow.publish.view.look import ARROWS, CAMERA, LEGEND, LINKS, TAXELS
from taxelflow.publish.view.names import Names
from taxelflow.publish.view.object_motion import ObjectMotion
from taxelflow.publish.view.palette import DARK, GREEN, GREY, VERMILION, Theme, ramp
from taxelflow.publish.view.placement import placed, spots_in_space, spots_of
from taxelflow.publish.view.plates import Plates
from taxelflow.publish.view.space_motion import SpaceMotion
from taxelflow.publish.view.vectors import Field

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Joints
    from taxelflow.publish.view.history import Results, Snapshot
    from taxelflow.sensors.sensor import Sensor


class Scene:
    """Draws snapshots. ring_m_s: speed that the first ring stands for. top: pressure at the top of the scale.

    lights_m: (pads, 3), where the lights of pads are. note: what the user should know about the pads' places.
    compares: whether a second method may be drawn. aspect, position: for which the camera was placed last, and where.
    """

    def __init__(self, server: Any, sensor: Sensor, joints: Joints | None = None, *, compares: bool = False) -> None:
        self._server, self.layout, self._sensor = server, sensor.layout, sensor
        self._fingers, self.note = fingers_of(sensor, joints)
        start_s = joints.t_s[0] if self._fingers is not None and joints is not None else 0.0
        self.placement = placed(self.layout) if self._fingers is None else self._fingers.at(start_s)
        self.theme: Theme = DARK
        self.top, self.ring_m_s = 1.0, 0.01
        self._pitch = float(np.median(self.layout.pitch_m[: self.layout.pad_count]))
        self._high = min(self._pitch, TAXELS.pitch_share * self.placement.size_m)
        self._ramp = as_lit(ramp(self.theme.idle))
        self._last: tuple[Snapshot, Results | None, Results | None] | None = None
        scene, size, entries = server.scene, self.placement.size_m, len(self.layout.pads)
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        self._axes = picture_axes(self._front())
        space = self.placement.spatial
        add_lights(scene, self._axes if space else picture_axes(np.array((0.0, 0.0, 1.0))), space=space)
        self._add_taxels()
        self._body = self._add_body()
        self._links = HandLinks(server, self._fingers.links, size) if self._fingers is not None else None
        seen_through = {} if self._links is None else {"opacity": LINKS.opacity}
        self._plates = Plates(server, self.layout, self.placement, **seen_through)
        self._radius = min(0.0095 * size, 0.9 * self._pitch)
        self._lights = add_batch(server, "/lights_of_pads", shapes.disc(), self.layout.pad_count, flat_shading=True)
        self._names = Names(server, self.layout, self.placement, self._radius)
        self._mark = mark = max(size, ARROWS.pads_across * self._narrow())
        self._arrows = Arrows(server, "/slip", entries, mark, rings=True)
        self._compared = Arrows(server, "/compared", entries, mark, wide=0.7, rings=False) if compares else None
        self.legend = Legend(server)
        self._motion = ObjectMotion(server, size) if self.placement.flat else None
        self._in_space = SpaceMotion(server, size) if self.placement.spatial else None
        self._field = Field(self.layout, self.placement)
        self._view: View | None = None
        self._named, self._lit = False, (self.theme, b"", b"")  # how lights were drawn last
        self._put()
        self.frame(self._front(), CAMERA.aspect)

    def configure(self, *, theme: Theme | None = None, top: float | None = None, ring_m_s: float | None = None) -> None:
        """Change the look or the scales. top: Pa or counts; ring_m_s: m/s."""
        self.theme = theme or self.theme
        self.top, self.ring_m_s = top or self.top, ring_m_s or self.ring_m_s
        self._ramp = as_lit(ramp(self.theme.idle))
        self._server.scene.set_background_image(np.full((2, 2, 3), self.theme.background, np.uint8), format="png")
        self._arrows.tint(lit(self.theme.ring))
        if self._named:
            self._names.tint(self.theme.words)
        if self._links is not None:
            self._links.tint(lit(self.theme.link))
        scale, unit = shown_unit(self._sensor)
        self.legend.show(self.theme, Scales(self.top * scale, unit, self.ring_m_s, self.follows))
        if self._last is None:
            self._taxels.batched_colors = np.tile(self._ramp[0], (self.layout.taxels, 1))
            self._light(None)
        else:
            self.show(*self._last)

    def show(self, snapshot: Snapshot, trail: Results | None = None, compared: Results | None = None) -> None:
        """Draw one scan. trail: results of the last seconds, for the object's path. compared: of a second method."""
        self._last = (snapshot, trail, compared)
        level = np.clip(snapshot.pressure / self.top, 0.0, 1.0)
        results, raised_m = snapshot.results, (TAXELS.arrows_above + TAXELS.raised) * self._high
        with self._server.atomic():
            if self._fingers is not None and self._fingers.moving:
                self.placement = self._fingers.at(snapshot.t_s)
                self._put()
            high, flat = TAXELS.floor + (TAXELS.raised - TAXELS.floor) * level, np.ones_like(level)
            heights = np.stack([flat, flat, high], axis=1)
            self._taxels.batched_colors = self._ramp[(255 * level).astype(int)]
            self._taxels.batched_scales = self._sizes * heights
            self._light(results)
            vectors = self._field.vectors(snapshot.pressure, results)
            self._arrows.draw(vectors, self._colours(results, self.theme.line), self._per_speed_s, raised_m)
            if self._compared is not None:
                others = self._field.vectors(snapshot.pressure, compared)
                colours = self._colours(compared, self.theme.second)
                self._compared.draw(others, colours, self._per_speed_s, raised_m + 0.3 * self._high)
            if self._motion is not None:
                self._motion.show(results, trail, self._high * (1.3 + TAXELS.raised), self._per_speed_s)
            if self._in_space is not None:
                touched = vectors.start[vectors.touched]
                middle = touched.mean(axis=0) if len(touched) else np.full(3, np.nan)
                now, before = (None if one is None else one.spatial for one in (results, trail))
                self._in_space.show(now, before, middle, self._per_speed_s)

    def name(self) -> None:
        """Write the names of pads, if that has not been done: the first picture does not wait for them."""
        if not self._named:
            self._named = True
            self._names.tint(self.theme.words)

    def frame(self, direction: Floats, aspect: float) -> Camera:
        """Place the camera of browsers that open later, and the scales, for a view from a direction (3,)."""
        place = self.placement
        axes = self._axes = picture_axes(direction)
        reach = place.place if self._fingers is None else self._fingers.reach
        points = np.concatenate([reach + side for side in self._pitch * np.concatenate([np.eye(3), -np.eye(3)])])
        if self._links is not None:
            points = np.concatenate([points, self._links.corners()])
        if not place.spatial:
            outer = ARROWS.ring * ARROWS.rings * self._mark
            rings = place.place + outer * np.array([[[0.6, 0, 0]], [[-0.6, 0, 0]], [[0, 0.6, 0]]])
            points = np.concatenate([points, self.lights_m - (0.0, 3.5 * self._radius, 0.0), *rings])
        self._points = points
        wide, high = np.ptp(points @ np.stack(axes[:2], axis=1), axis=0)
        wide_m = max(float(wide), LEGEND.height_share * aspect * float(high))
        points = np.concatenate([points, self.legend.place(points, axes, wide_m)])
        found, camera = fitted(points, direction, aspect), self._server.initial_camera
        self._view = view_of(found, self._points, wide_m)
        self._put()
        self.aspect, self.position = aspect, found.position
        far = float(np.linalg.norm(found.position - found.look_at))
        camera.fov, camera.near, camera.far = CAMERA.fov_rad, far / 100, 100 * far
        camera.up, camera.look_at, camera.position = (0.0, 0.0, 1.0), found.look_at, found.position
        return found

    def turn(self, camera: Camera) -> None:
        """Let names and scales face a camera that has moved."""
        if self._view is None:
            return
        view = view_of(camera, self._points, self._view.wide_m)
        same = float(view.axes.out @ self._view.axes.out) > np.cos(np.radians(CAMERA.same_turn_deg))
        if view.front_m <= 0 or (same and np.linalg.norm(view.eye - self._view.eye) < CAMERA.same_place * view.front_m):
            return
        self._view = view
        with self._server.atomic():
            self._names.move(self.lights_m, self._anchors, view)
            if not same:
                self.legend.place(self._points, view.axes, view.wide_m)

    def seen_from(self, pressure: Floats | None) -> Floats:
        """(3,), the usual direction of view; for a skin that is closed, and so has none, one that shows the pressure
        (taxels,).
        """
        weight = np.zeros(1) if pressure is None else np.maximum(pressure, 0.0)
        if not (self.placement.closed and weight.sum() > 0):
            return self._front()
        direction: Floats = weight @ self.placement.normal / weight.sum()
        return np.asarray(direction / max(float(np.linalg.norm(direction)), shapes.NONE) + CAMERA.from_above)

    def facing(self, pad: str) -> Floats:
        """(3,), direction from which a pad is seen best: from above its skin, in space; else the usual one."""
        if not self.placement.spatial:
            return np.array(CAMERA.front)
        own = self.layout.of_pad(self.layout.pads.index(pad))
        return np.asarray(self.placement.normal[self.layout.source[own]].mean(axis=0) + CAMERA.from_above)

    @property
    def follows(self) -> bool:
        """Whether the object's motion is drawn, and its path over the last seconds with it."""
        return self._motion is not None or self._in_space is not None

    @property
    def _per_speed_s(self) -> float:
        """Length of an arrow over its speed."""
        return ARROWS.ring * self._mark / self.ring_m_s

    def _front(self) -> Floats:
        """The usual direction of view: of fingers the clearest, of a skin in space between the front and its normal."""
        place = self.placement
        if not place.spatial:
            return np.array(CAMERA.front)
        if self._fingers is not None:
            home = np.repeat(np.arange(self.layout.pad_count), np.diff(self.layout.starts[: self.layout.pad_count + 1]))
            return clearest(place.place, place.normal, home, self._pitch)
        mean: Floats = place.normal.mean(axis=0)
        length = float(np.linalg.norm(mean))
        return np.array(CAMERA.front) if place.closed else np.asarray(mean / length + 0.6 * np.array(CAMERA.front))

    def _narrow(self) -> float:
        """Smaller side of a usual pad, m."""
        layout = self.layout
        own = [layout.of_pad(pad) for pad in range(layout.pad_count)]
        sides = [min(np.ptp(layout.x_m[each]), np.ptp(layout.y_m[each])) for each in own]
        return float(np.median(sides))

    def _add_taxels(self) -> None:
        layout = self.layout
        counts = np.diff(layout.starts[: layout.pad_count + 1])
        pitch = np.repeat(layout.pitch_m[: layout.pad_count], counts, axis=0)
        tables = bool(layout.tables[: layout.pad_count].any())
        wide = 0.9 * (np.sqrt(4 * layout.area_m2[: layout.taxels] / np.pi)[:, np.newaxis] if tables else pitch)
        wide = np.minimum(np.broadcast_to(wide, pitch.shape), 0.95 * pitch)
        self._sizes = np.column_stack([wide, np.full(layout.taxels, self._high)])
        shape, scales = shapes.disc() if tables else shapes.box(), self._sizes * (1.0, 1.0, TAXELS.floor)
        self._taxels = add_batch(self._server, "/taxels", shape, layout.taxels, scales=scales, flat_shading=True)

    def _add_body(self) -> Any:
        """A solid inside a closed skin, that hides the taxels of the far side; None where none fits."""
        body = shapes.inside(self.placement.place) if self.placement.closed else None
        return None if body is None else add_batch(self._server, "/body", body, 1, scales=np.ones((1, 3)))

    def _put(self) -> None:
        """Move everything that belongs to a pad to where the pads are."""
        place, layout, radius = self.placement, self.layout, self._radius
        if self._links is not None and self._fingers is not None:
            self._links.move(self._fingers.link_poses())
        self._field.placement = place
        turned = shapes.along(place.normal, place.tangent[:, :, 0])
        put(self._taxels, batched_positions=place.place, batched_wxyzs=turned)
        self._plates.move(place)
        if self._names.crowded:  # beside one pad is another
            own = [layout.of_pad(pad) for pad in range(layout.pad_count)]
            above = place.place + (TAXELS.raised + 0.2) * self._high * place.normal
            self.lights_m = np.array([above[each].mean(axis=0) for each in own])
            self._anchors: list[str] = []
        elif place.spatial:
            self.lights_m, self._anchors = spots_in_space(layout, place, radius, self._axes)
        else:
            self.lights_m, self._anchors = spots_of(layout, place, radius)
        put(self._lights, batched_positions=self.lights_m)
        if self._view is not None:
            self._names.move(self.lights_m, self._anchors, self._view)

    def _light(self, results: Results | None) -> None:
        count = self.layout.pad_count
        slips: Bools = np.zeros(count, dtype=np.bool_)
        touched = slips
        if results is not None:
            touched, slips = results.slips.contact[0, :count], results.slipping[0, :count].copy()
            for entry in range(count, len(self.layout.pads)):  # a group or contact that slips lights its pad
                home = int(np.searchsorted(self.layout.starts, self.layout.source[self.layout.starts[entry]], "right"))
                slips[home - 1] |= results.slipping[0, entry]
        drawn = (self.theme, touched.tobytes(), slips.tobytes())
        if drawn == self._lit:
            return
        self._lit = drawn
        orange, plate = lit(VERMILION), lit(self.theme.plate)
        pressed = np.where(touched[:, np.newaxis], lit(GREEN), lit(self.theme.idle))
        shown = touched | slips | (not self._names.crowded)  # lights of crowded pads in space would hide them
        size = np.array((2.0, 2.0, 0.5)) * self._radius
        scales = np.where(shown[:, np.newaxis], size, shapes.NONE)
        put(self._lights, batched_scales=scales, batched_colors=np.where(slips[:, np.newaxis], orange, pressed))
        self._plates.tint(np.where(slips[:, np.newaxis], lit(self.theme.glow), plate))
        if self._body is not None:
            put(self._body, batched_colors=lit(self.theme.body)[np.newaxis])

    def _colours(self, results: Results | None, sure: Any) -> Any:
        """(entries, 3), of the arrows: grey where the pose is not resolved."""
        quality = np.full(len(self.layout.pads), NO_POSE) if results is None else results.slips.quality[0]
        known = (quality == OK) | (quality == NO_POSE) | (quality == LOST)
        return np.where(known[:, np.newaxis], lit(sure), lit(GREY))
