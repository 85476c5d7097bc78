from __future__ import annotations

import csv
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from synthetic import METHODS, grid_sensor, scans_of
from taxelflow.messages import Estimates, Footprint, Motions, Slips
from taxelflow.pipeline.api import estimate
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.columns import CONTACTS, OBJECT, SLIPS, as_text, motion_rows, slip_columns, slip_rows
from taxelflow.publish.tables import Tables
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Bools, Floats

CONTRACT = (
    "t_s,pad,contact,dx_m,dy_m,dtheta_rad,x_m,y_m,theta_rad,vx_m_s,vy_m_s,omega_rad_s,"
    "std_x_m,std_y_m,std_theta_rad,slipping"
)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def written(recording: Recording, folder: Path, method: str = "convolution") -> Path:
    run = Pipeline(registry.find("estimator", method)()).start(recording)
    with Tables(folder, recording.layout.pads) as tables:
        for output in run:
            tables.write(output.slips, output.slipping, output.motions, output.events, output.contacts, output.evidence)
    return folder


def test_the_columns_are_the_contracts_and_then_more() -> None:
    assert ",".join(SLIPS).startswith(
        CONTRACT + ",border_x,border_y,lag_s,load_pa,cov_xy,cov_xtheta,cov_ytheta,quality,evidence"
    )


def test_the_header_of_the_file_is_the_contracts(stroke: Recording, tmp_path: Path) -> None:
    header = (written(stroke, tmp_path / "out") / "slips.csv").read_text().splitlines()[0]
    assert header.startswith(CONTRACT + ",")


def test_there_is_a_row_per_scan_and_pad_in_time_order(stroke: Recording, tmp_path: Path) -> None:
    rows = rows_of(written(stroke, tmp_path) / "slips.csv")
    assert len(rows) == 80
    assert [float(row["t_s"]) for row in rows] == pytest.approx(list(np.arange(80) / 10), abs=1e-6)
    assert {row["pad"] for row in rows} == {"pad0"}


@pytest.mark.parametrize("method", mostly_long(METHODS, "convolution"))
def test_numbers_are_those_of_the_messages_and_the_unknown_is_empty(
    stroke: Recording, tmp_path: Path, method: str
) -> None:
    result = estimate(stroke, method)
    rows = rows_of(written(stroke, tmp_path, method) / "slips.csv")
    slips = result.slips
    std = np.sqrt(np.diagonal(slips.covariance[:, 0], axis1=1, axis2=2))
    columns = {
        "dx_m": slips.displacement[:, 0, 0],
        "dy_m": slips.displacement[:, 0, 1],
        "dtheta_rad": slips.displacement[:, 0, 2],
        "x_m": slips.pose[:, 0, 0],
        "y_m": slips.pose[:, 0, 1],
        "theta_rad": slips.pose[:, 0, 2],
        "vx_m_s": slips.velocity[:, 0, 0],
        "vy_m_s": slips.velocity[:, 0, 1],
        "omega_rad_s": slips.velocity[:, 0, 2],
        "std_x_m": std[:, 0],
        "std_y_m": std[:, 1],
        "std_theta_rad": std[:, 2],
        "cov_xy": slips.covariance[:, 0, 0, 1],
        "cov_xtheta": slips.covariance[:, 0, 0, 2],
        "cov_ytheta": slips.covariance[:, 0, 1, 2],
        "lag_s": slips.lag_s[:, 0],
        "load_pa": slips.load[:, 0],
        "evidence": result.evidence[:, 0],
    }
    for name, values in columns.items():
        read = [float(row[name]) if row[name] else np.nan for row in rows]
        np.testing.assert_allclose(read, values, rtol=1e-8, err_msg=name)
    for name, flags in (
        ("contact", slips.contact[:, 0]),
        ("slipping", result.slipping[:, 0]),
        ("border_x", slips.border[:, 0, 0]),
        ("border_y", slips.border[:, 0, 1]),
    ):
        assert [row[name] for row in rows] == [str(int(flag)) for flag in flags], name


def drawn_slips(pads: int = 2) -> tuple[Slips, Bools, Floats]:
    """Slips of three scans in which no two numbers are equal, whether they slip, and evidence."""
    random = np.random.default_rng(0)
    root = random.normal(0, 1, (3, pads, 3, 3))
    border = np.stack([random.random((3, pads)) < 0.5, np.ones((3, pads), np.bool_)], axis=-1)
    footprint = Footprint(np.arange(3.0), np.ones((3, pads), np.bool_), border, random.random((3, pads)))
    slips = replace(
        Slips.of(footprint, Estimates.unknown(scans_of(grid_sensor(2, 2, pads=pads), np.ones((3, 4 * pads))))),
        pose=random.random((3, pads, 3)),
        displacement=random.random((3, pads, 3)),
        covariance=root @ np.swapaxes(root, 2, 3),
        lag_s=random.random((3, pads)),
    )
    return slips, random.random((3, pads)) < 0.5, random.random((3, pads))


def test_columns_of_arrays_are_those_of_the_file(tmp_path: Path) -> None:
    slips, slipping, evidence = drawn_slips()
    columns = slip_columns(slips, slipping, evidence, ("left", "right"))
    texts = as_text(SLIPS, slip_rows(slips, slipping, evidence, ("left", "right")))
    rows = [dict(zip(SLIPS, row, strict=True)) for row in texts]
    assert [*columns] == [*SLIPS]
    for name, column in columns.items():
        read = [row[name] for row in rows]
        if column.dtype.kind in "UO":
            assert read == [one or "" for one in column.tolist()]
        else:
            np.testing.assert_allclose(
                [float(one or "nan") for one in read], column.astype(float), rtol=1e-8, err_msg=name
            )
    np.testing.assert_allclose(columns["cov_ytheta"].reshape(3, 2), slips.covariance[:, :, 1, 2])
    np.testing.assert_allclose(columns["cov_xtheta"].reshape(3, 2), slips.covariance[:, :, 0, 2])
    np.testing.assert_allclose(columns["std_y_m"].reshape(3, 2) ** 2, slips.covariance[:, :, 1, 1])
    assert columns["border_y"].all()
    assert not columns["border_x"].all()


def test_the_objects_motion_has_a_row_per_scan(stroke: Recording, tmp_path: Path) -> None:
    motions = estimate(stroke).motions
    rows = rows_of(written(stroke, tmp_path) / "object.csv")
    assert len(rows) == 80
    for name, values in (("vx_m_s", motions.velocity[:, 0]), ("x_m", motions.pose[:, 0]), ("pads", motions.pads)):
        read = [float(row[name]) if row[name] else np.nan for row in rows]
        np.testing.assert_allclose(read, values, rtol=1e-8, err_msg=name)


def test_columns_of_the_objects_motion_are_those_of_the_message() -> None:
    random = np.random.default_rng(0)
    root, other = random.normal(0, 1, (2, 4, 3, 3))
    covariance, pose_covariance = root @ np.swapaxes(root, 1, 2), other @ np.swapaxes(other, 1, 2)
    motions = Motions(
        t_s=np.arange(4.0), velocity=random.random((4, 3)), velocity_covariance=covariance, rotor=random.random(4),
        rotor_std=random.random(4), centre=random.random((4, 2)), centre_std=random.random((4, 2)),
        pose=random.random((4, 3)), pose_covariance=pose_covariance, pads=np.arange(4),
    )  # fmt: skip
    found = dict(zip(OBJECT, np.array([*motion_rows(motions)]).T, strict=True))
    velocity_std, pose_std = (np.sqrt(np.diagonal(one, axis1=1, axis2=2)) for one in (covariance, pose_covariance))
    parts = {
        ("t_s",): motions.t_s, ("pads",): motions.pads, ("rotor_1_s",): motions.rotor,
        ("vx_m_s", "vy_m_s", "omega_rad_s"): motions.velocity, ("cx_m", "cy_m"): motions.centre,
        ("x_m", "y_m", "theta_rad"): motions.pose, ("std_rotor_1_s",): motions.rotor_std,
        ("std_cx_m", "std_cy_m"): motions.centre_std, ("std_x_m", "std_y_m", "std_theta_rad"): pose_std,
        ("std_vx_m_s", "std_vy_m_s", "std_omega_rad_s"): velocity_std,
    }  # fmt: skip
    assert {name for names in parts for name in names} == {*OBJECT}
    for names, values in parts.items():
        for name, column in zip(names, values.reshape(4, -1).T, strict=True):
            np.testing.assert_array_equal(found[name], column, err_msg=name)


def test_what_an_earlier_run_has_left_is_removed(tmp_path: Path) -> None:
    for name in ("slips.csv", "object3d.csv", "summary.json", "patterns.npz"):
        (tmp_path / name).write_text("old")
    with Tables(tmp_path, ("pad0",)):
        assert all(path.suffix == ".part" for path in tmp_path.iterdir())
    assert "old" not in [path.read_text() for path in tmp_path.iterdir()]


def test_events_have_time_pad_and_kind(stroke: Recording, tmp_path: Path) -> None:
    rows = rows_of(written(stroke, tmp_path) / "events.csv")
    motion = ["onset_s", "direction_rad", "speed_m_s", "turn_rad_s"]
    whole = ["path_m", "turn_rad", "duration_s"]
    std = ["std_speed_m_s", "std_path_m", "std_turn_rad", "std_duration_s"]
    assert list(rows[0]) == ["t_s", "pad", "event", *motion, "evidence", "quality", *whole, *std]
    assert [row["event"] for row in rows if row["event"] in ("contact", "release")] == ["contact", "release"]
    assert {row["event"] for row in rows} <= {"contact", "release", "slip_start", "slip_stop", "slip_suspected"}
    for row in rows:
        slip = row["event"].startswith("slip")
        assert bool(row["onset_s"]) == bool(row["speed_m_s"]) == bool(row["direction_rad"]) == slip
        assert bool(row["quality"]) == slip
        assert not slip or float(row["onset_s"]) <= float(row["t_s"])
        assert row["turn_rad_s"] == row["turn_rad"] == row["std_turn_rad"] == ""  # the L norm knows none
        for name in ("path_m", "duration_s", "std_speed_m_s", "std_path_m", "std_duration_s"):
            assert bool(row[name]) == (row["event"] in ("slip_start", "slip_stop")), name


def test_contacts_have_a_row_per_scan_and_pad_in_contact(stroke: Recording, tmp_path: Path) -> None:
    contacts = estimate(stroke).contacts
    rows = rows_of(written(stroke, tmp_path) / "contacts.csv")
    assert list(rows[0]) == list(CONTACTS)
    touching = contacts.contact[:, 0]
    assert len(rows) == touching.sum() > 0
    for name, values in (
        ("t_s", contacts.t_s),
        ("force_n", contacts.force[:, 0]),
        ("area_m2", contacts.area[:, 0]),
        ("peak_pa", contacts.peak[:, 0]),
        ("x_m", contacts.centroid[:, 0, 0]),
        ("y_m", contacts.centroid[:, 0, 1]),
        ("major_m", contacts.axes[:, 0, 0]),
        ("minor_m", contacts.axes[:, 0, 1]),
        ("eccentricity", contacts.eccentricity[:, 0]),
        ("orientation_rad", contacts.orientation[:, 0]),
        ("std_force_n", contacts.force_std[:, 0]),
        ("std_orientation_rad", contacts.orientation_std[:, 0]),
    ):
        read = [float(row[name]) if row[name] else np.nan for row in rows]
        np.testing.assert_allclose(read, values[touching], rtol=1e-8, atol=1e-12, err_msg=name)


def test_rows_stand_in_part_files_until_the_end(stroke: Recording, tmp_path: Path) -> None:
    run = Pipeline(registry.find("estimator", "lnorm")()).start(stroke)
    with Tables(tmp_path, stroke.layout.pads) as tables:
        for output in run:
            tables.write(output.slips, output.slipping, output.motions, output.events, output.contacts, output.evidence)
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            "contacts.csv.part",
            "events.csv.part",
            "object.csv.part",
            "slips.csv.part",
        ]
        assert len(rows_of(tmp_path / "slips.csv.part")) == 80
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "contacts.csv",
        "events.csv",
        "object.csv",
        "slips.csv",
    ]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError, SystemExit])
def test_an_interruption_keeps_the_part_files(
    stroke: Recording, tmp_path: Path, interruption: type[BaseException]
) -> None:
    run = Pipeline(registry.find("estimator", "lnorm")()).start(stroke)
    with pytest.raises(interruption), Tables(tmp_path, stroke.layout.pads) as tables:
        for output in run:
            tables.write(output.slips, output.slipping, output.motions, output.events, output.contacts, output.evidence)
        raise interruption
    assert not (tmp_path / "slips.csv").exists()
    assert len(rows_of(tmp_path / "slips.csv.part")) == 80


def test_no_number_is_written_as_nan_or_inf(stroke: Recording, tmp_path: Path) -> None:
    folder = written(stroke, tmp_path)
    for name in ("slips.csv", "object.csv", "events.csv", "contacts.csv"):
        text = (folder / name).read_text().lower()
        assert "nan" not in text
        assert "inf" not in text
