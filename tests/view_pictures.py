"""Pictures of the view for the docs: `python tests/view_pictures.py [FOLDER]` simulates, opens a browser, and shoots.

TAXELFLOW_DATA, if set, adds the real SDH recording.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from browsed import installed_browser, opened
from rigged import rigged
from taxelflow.evaluation.view import Filling
from taxelflow.pipeline import api
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.view.history import History
from taxelflow.publish.view.page import Page
from taxelflow.publish.view.palette import round_up
from taxelflow.publish.view.server import PageServer
from taxelflow.simulation.grasp import Grasp, simulate_grasp
from taxelflow.simulation.simulate import save

SIZE = {"width": 1400, "height": 860}
SHOTS = {
    "barretthand": ("slide-and-turn-over-hand", {}, "template"),
    "inspire": ("stroke", {"sensor": "inspire-rh56dftp@3.0mm", "pad": "palm"}, "convolution"),
    "icub": ("bulb-pull", {"sensor": "icub-forearm"}, "convolution"),
}
GRASP = "grasp"
REAL = ("sdh", "sdh-dsa/tennisball.dsa", "template")


def shoot(recording: Path, method: str, out: Path, *, light: bool = False, flat: bool = False) -> None:
    """A picture at the middle of the strongest slip, its pressures over the whole scale."""
    read = api.read(recording)
    history = History()
    Filling(read, Pipeline(api.estimator(method)), history).fill()
    page = Page(
        read.sensor, (history,), f"{recording.name}, {method}", PageServer(port=0), None if flat else read.joints
    )
    page.player.playing = False
    try:
        with opened(page, installed_browser(), SIZE) as browsed:
            browsed.tick()
            slips = [event for event in history.events if event.event == "slip_start" and event.pad in read.layout.pads]
            loudest = max(slips, key=lambda event: event.path_m if event.path_m == event.path_m else 0.0)
            page.player.seek(loudest.onset_s + 0.5 * loudest.duration_s)
            page.panel.pad.value = loudest.pad
            page.panel.light.value = light
            seen = history.at(page.player.at_s)
            browsed.tick()
            page.panel.set_scales(round_up(0.9 * float(seen.pressure.max())), page.scene.ring_m_s)
            page.apply_look()
            browsed.tick()
            camera = browsed.client.camera
            found = page.scene.frame(page.direction(), camera.image_width / camera.image_height)
            camera.position, camera.look_at = found.position, found.look_at
            browsed.tab.add_style_tag(content=".mantine-Notification-root { display: none; }")  # drawn in software
            browsed.tab.wait_for_timeout(2500)
            browsed.tab.screenshot(path=out, timeout=60000)
            print(out, browsed.errors)
    finally:
        page.close()


def main() -> None:
    """Shoot all, or those named after the folder."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
    wanted = set(sys.argv[2:])
    with TemporaryDirectory() as made:
        for name, (scenario, changes, method) in SHOTS.items():
            if not wanted or name in wanted:
                recording = Path(made) / f"{name}.npz"
                save(rigged(scenario, **changes), recording)
                shoot(recording, method, folder / f"view-{name}.png", light=name == "inspire")
        if not wanted or GRASP in wanted:
            recording = Path(made) / f"{GRASP}.npz"
            api.convert(simulate_grasp(Grasp()).recording, recording)
            shoot(recording, "template", folder / f"view-{GRASP}.png")
    real = Path(os.environ.get("TAXELFLOW_DATA", "")) / REAL[1]
    if real.is_file() and (not wanted or REAL[0] in wanted):
        shoot(real, REAL[2], folder / f"view-{REAL[0]}.png", flat=True)


if __name__ == "__main__":
    main()
