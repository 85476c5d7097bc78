from __future__ import annotations

import threading
from typing import Any

import pytest

from taxelflow.sensors.catalogue import load_sensor
from viewed import viewed

PAD = "finger1_proximal"


def test_a_browser_that_changes_the_look_does_not_bring_back_an_older_picture() -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    from taxelflow.publish.view.page import Page
    from taxelflow.publish.view.server import PageServer

    sensor = load_sensor("schunk-sdh2")
    histories = viewed(sensor, PAD, 0.0), viewed(sensor, PAD, 1.0)
    histories[0].method, histories[1].method = "first", "second"
    page = Page(sensor, histories, "a slip", PageServer(port=0))
    compared: Any = page.scene._compared
    drawn, inside, go_on = compared.draw, threading.Event(), threading.Event()

    def slowly(*asked: Any) -> None:
        inside.set()
        assert go_on.wait(60.0)
        drawn(*asked)

    try:
        page.player.playing = False
        page.show_at(11.5)
        assert compared.arrows.visible
        assert compared.arrows.batched_scales.max() > 1e-4
        compared.draw = slowly
        looking = threading.Thread(target=page.apply_look)  # as a callback of the browser does
        looking.start()
        assert inside.wait(60.0)
        page.panel.second.value = "none"
        ticking = threading.Thread(target=page.tick, args=(1.0, 0.0))
        ticking.start()
        assert not page._drawing.acquire(blocking=False)  # nobody draws in between
        go_on.set()
        looking.join(60.0)
        ticking.join(60.0)
        assert not compared.arrows.visible
    finally:
        page.close()


@pytest.mark.parametrize(("name", "known"), [("inspire-rh56dftp@3.0mm", False), ("schunk-sdh2", True)])
def test_the_motion_of_the_hand_is_drawn_only_where_all_pads_have_a_place(name: str, known: bool) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    from taxelflow.publish.view.scene import Scene
    from taxelflow.publish.view.server import PageServer

    with PageServer(port=0) as server:
        assert Scene(server.viser, load_sensor(name)).follows is known


def test_marks_that_show_nothing_yet_are_not_drawn() -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    from taxelflow.publish.view.scene import Scene
    from taxelflow.publish.view.server import PageServer

    history = viewed(load_sensor("schunk-sdh2"), PAD, 0.0)
    with PageServer(port=0) as server:
        scene = Scene(server.viser, load_sensor("schunk-sdh2"), compares=True)
        arrows, compared = scene._arrows, scene._compared
        assert compared is not None
        marks = [arrows.arrows, arrows._rings, compared.arrows]
        assert not any(mark.visible for mark in marks)
        slipping, still = history.at(11.5), history.at(10.0)
        assert slipping is not None
        assert still is not None
        scene.show(slipping, compared=slipping.results)
        assert all(mark.visible for mark in marks)
        scene.show(still)
        assert not any(mark.visible for mark in marks)
