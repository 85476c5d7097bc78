from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from browsed import Browsed, installed_browser, opened
from taxelflow.publish.view.camera import picture_axes
from taxelflow.sensors.catalogue import load_sensor
from viewed import viewed

if TYPE_CHECKING:
    from collections.abc import Iterator

PAD, DIRECTION_RAD = "finger1_proximal", 0.6


@pytest.fixture(scope="module")
def browsed() -> Iterator[Browsed]:
    executable = installed_browser()
    from taxelflow.publish.view.page import Page
    from taxelflow.publish.view.server import PageServer

    sensor = load_sensor("schunk-sdh2")
    first, second = viewed(sensor, PAD, DIRECTION_RAD), viewed(sensor, PAD, DIRECTION_RAD + 2.0)
    first.method, second.method = "first", "second"
    page = Page(sensor, (first, second), "a slip", PageServer(port=0))
    page.player.playing = False
    page.panel.second.value = "none"
    try:
        with opened(page, executable) as found:
            found.tick()
            yield found
    finally:
        page.close()


def seen_at(browsed: Browsed, at_s: float) -> np.ndarray:
    player = browsed.page.player
    player.seek(at_s)
    browsed.tick()
    browsed.tab.locator("strong", has_text=f"{at_s - player.first_s:.3f} s").first.wait_for()
    return browsed.settled()


def test_every_pad_is_drawn_and_pressure_has_colour(browsed: Browsed) -> None:
    picture, scene = seen_at(browsed, 10.5), browsed.page.scene
    layout, place = scene.layout, scene.placement.place
    background = np.median(picture[:5].reshape(-1, 3), axis=0)
    for pad, name in enumerate(layout.pads):
        own = place[layout.of_pad(pad)]
        at = browsed.pixels(own).round().astype(int)
        colours = picture[at[:, 1], at[:, 0]]
        drawn = np.abs(colours - background).max(axis=1) > 8
        assert drawn.mean() > 0.9, name
        assert (np.ptp(colours, axis=0).max() > 60) == (name == PAD), name


def test_an_arrow_points_where_the_object_slips(browsed: Browsed) -> None:
    still, slipping = seen_at(browsed, 10.5), seen_at(browsed, 11.5)
    scene = browsed.page.scene
    own = scene.layout.of_pad(scene.layout.pads.index(PAD))
    middle = scene.placement.place[own].mean(axis=0)
    length = 0.03
    ends = middle + np.array([[0.0, 0.0, 0.0], [length * np.cos(DIRECTION_RAD), length * np.sin(DIRECTION_RAD), 0.0]])
    start, tip = browsed.pixels(ends)
    white = slipping.min(axis=2) > 165  # rings are darker, pressure has colour
    rows, columns = np.nonzero((np.abs(slipping - still).max(axis=2) > 30) & white)
    near = np.hypot(columns - start[0], rows - start[1]) < 120
    arrow = np.column_stack([columns, rows])[near].astype(float)
    assert len(arrow) > 30
    axis = np.linalg.svd(arrow - arrow.mean(axis=0))[2][0]
    axis *= np.sign(axis @ (arrow.mean(axis=0) - start))
    expected = (tip - start) / np.linalg.norm(tip - start)
    assert np.degrees(np.arccos(np.clip(axis @ expected, -1, 1))) < 5


def test_a_slip_lights_its_pad_and_no_other(browsed: Browsed) -> None:
    scene = browsed.page.scene
    spots = browsed.pixels(scene.lights_m).round().astype(int)

    def orange(at_s: float) -> list[bool]:
        colours = seen_at(browsed, at_s)[spots[:, 1], spots[:, 0]]
        return [bool(red > 1.5 * green and red > 2 * blue) for red, green, blue in colours]

    assert not any(orange(10.5))
    assert orange(11.5) == [name == PAD for name in scene.layout.pads]
    assert not any(orange(12.5))


def test_play_scrub_step_and_slips_work_from_the_panel(browsed: Browsed) -> None:
    player, tab = browsed.page.player, browsed.tab
    player.seek(10.0)
    browsed.tick()
    tab.get_by_role("button", name="play / pause").click()
    browsed.wait_for(lambda: player.playing)
    browsed.tick(0.5)
    assert player.at_s == pytest.approx(10.5)
    scrub = tab.get_by_role("slider").first
    browsed.wait_for(lambda: float(scrub.get_attribute("aria-valuenow")) == pytest.approx(player.at_s - player.first_s))
    scrub.focus()
    before = player.at_s
    scrub.press("ArrowRight")
    browsed.wait_for(lambda: not player.playing and player.at_s != before)
    assert player.at_s > before
    before = player.at_s
    tab.get_by_role("button", name="+ scan").click()
    browsed.wait_for(lambda: player.at_s != before)
    tab.get_by_role("button", name="next").click()
    browsed.wait_for(lambda: player.at_s == 11.0)
    browsed.tick()
    tab.get_by_text("1.000 s").first.wait_for()
    tab.get_by_text(PAD).first.wait_for()


def test_a_slip_is_gone_to_from_the_event_strip(browsed: Browsed) -> None:
    player, tab = browsed.page.player, browsed.tab
    player.seek(10.2)
    browsed.tick()
    tab.locator("svg rect[fill='#eb5a14']").first.wait_for(state="attached")
    tab.get_by_role("button", name=f"1.000 s {PAD}").click()
    browsed.wait_for(lambda: player.at_s == 11.0)
    assert not player.playing


def test_a_press_on_the_event_strip_goes_to_that_time(browsed: Browsed) -> None:
    player, tab = browsed.page.player, browsed.tab
    player.seek(10.2)
    player.playing = True
    browsed.tick()
    strip = tab.locator("svg rect[fill='transparent']")
    strip.wait_for()
    box = strip.bounding_box()
    tab.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    middle = 0.5 * (player.first_s + player.last_s)
    browsed.wait_for(lambda: player.at_s == pytest.approx(middle, abs=0.02))
    assert not player.playing


def test_a_second_method_has_arrows_of_its_own(browsed: Browsed) -> None:
    def blue(picture: np.ndarray) -> int:
        """Pixels of the second method's colour."""
        red, green, blue = np.moveaxis(picture, 2, 0)
        return int(((blue > red + 80) & (blue > 180) & (green > 150)).sum())

    alone = blue(seen_at(browsed, 11.5))  # white edges over blue taxels
    browsed.page.panel.second.value = "second"
    browsed.tick()
    assert blue(browsed.settled(lambda picture: blue(picture) > alone + 9)) > alone + 9
    browsed.page.panel.second.value = "none"
    browsed.tick()
    assert blue(browsed.settled(lambda picture: blue(picture) <= alone + 9)) <= alone + 9


def test_names_face_the_camera_that_a_user_turns(browsed: Browsed) -> None:
    camera, words = browsed.client.camera, browsed.page.scene._names._words[0]
    place, target, before = camera.position.copy(), camera.look_at.copy(), words._handle.wxyz.copy()

    def turned() -> bool:
        browsed.tick()
        return bool(np.abs(words._handle.wxyz - before).max() > 0.1)

    def stand(at: np.ndarray) -> None:
        camera.position, camera.look_at = at, target

    stand(target + np.array([0.5, 0.3, 0.2]))
    browsed.wait_for(turned)
    assert words._handle.wxyz == pytest.approx(picture_axes(np.array([0.5, 0.3, 0.2])).wxyz, abs=0.02)
    stand(place)
    browsed.wait_for(lambda: not turned())


def test_the_console_reports_no_error(browsed: Browsed) -> None:
    seen_at(browsed, 11.5)
    assert browsed.errors == []


def test_a_second_browser_that_leaves_costs_nothing(browsed: Browsed) -> None:
    second = browsed.tab.context.browser.new_page()
    second.goto(browsed.page.url)
    browsed.wait_for(lambda: len(browsed.page.clients) == 2)
    second.close()
    browsed.wait_for(lambda: len(browsed.page.clients) == 1)
    assert seen_at(browsed, 11.0).shape[2] == 3


def test_the_scene_is_saved_as_png(browsed: Browsed) -> None:
    from imageio.v3 import imread

    seen_at(browsed, 11.5)
    browsed.tab.get_by_text("Look", exact=True).click()
    with browsed.tab.expect_download() as saved:
        browsed.tab.get_by_role("button", name="Save PNG").click()
    assert saved.value.suggested_filename == "taxelflow.png"
    picture = imread(saved.value.path())
    assert picture.shape[0] == browsed.client.camera.image_height
    assert np.ptp(picture[..., :3]) > 100
