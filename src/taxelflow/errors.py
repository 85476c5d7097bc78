"""The tree of errors. Each message states what is wrong, what was seen, and what is allowed or what to do.

TaxelflowError
├── RecordingError            a recording cannot be used
│   ├── RecordingMissing      no such file
│   ├── FormatUnknown         no reader for this file
│   ├── RecordingCorrupt      not of the format of its suffix, or damaged before the first scan
│   ├── RecordingTruncated    damaged after some scans, which were read
│   ├── TaxelCountWrong       the scans do not fit the sensor
│   ├── TimesNotIncreasing    a time stamp decreases
│   ├── SensorNeeded          the recording contains no sensor and none was given
│   └── TopicUnclear          a bag has no suitable topic, or several
├── SensorFileInvalid         a sensor file violates the schema
├── PitchNeeded               a built-in sensor whose pitch the user has to give
├── GridNameInvalid           the name of a plain grid is malformed
├── NameUnknown               no sensor, estimator, ... of that name
├── ParameterInvalid          a parameter is out of range
├── ResultMissing             a directory is not a result, or lacks a file
├── CalibrationError          gains cannot be estimated or used
│   ├── CalibrationInvalid    a calibration file is invalid
│   ├── CalibrationUnfit      a calibration of another sensor or method
│   └── GainsUnknown          recording and truth do not determine the gains
├── EstimatorBroken           an estimator of another package breaks its protocol
├── TruthInvalid              a robot's trajectory cannot be read
└── ExtraMissing              an optional dependency is not installed
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


class TaxelflowError(Exception):
    """Root of all errors that taxelflow raises; the CLI prints them as one line."""


class RecordingError(TaxelflowError):
    """A recording cannot be used."""


class RecordingMissing(RecordingError):
    """There is no file or bag at the path."""

    def __init__(self, path: Path) -> None:
        what = "is a directory but no ROS 2 bag (it has no metadata.yaml)" if path.is_dir() else "does not exist"
        super().__init__(f"recording {path} {what}; give the path of a recording")


class FormatUnknown(RecordingError):
    """No reader or writer is registered for the file's suffix."""

    def __init__(self, path: Path, known: Iterable[str], part: str = "reader") -> None:
        super().__init__(
            f"no {part} for {path}: its suffix is {path.suffix or 'empty'!r}; known are {', '.join(known)}"
        )


class RecordingCorrupt(RecordingError):
    """The content is not of the format of the suffix, or is damaged before the first scan."""

    def __init__(self, path: Path | str, seen: str, remedy: str) -> None:
        super().__init__(f"cannot read {path}: {seen}; {remedy}")


class RecordingTruncated(RecordingError):
    """The recording is incomplete; the scans before the damage have been delivered.

    read: number of these scans. expected: number that the file declares, None if unknown.
    """

    def __init__(self, path: Path, read: int, expected: int | None, seen: str) -> None:
        self.read, self.expected = read, expected
        of = f" of {expected}" if expected is not None else ""
        super().__init__(f"{path} is truncated: {read}{of} scans could be read ({seen}); record or copy it again")


class TaxelCountWrong(RecordingError):
    """The number of taxels per scan differs from the sensor's."""

    def __init__(self, path: Path | str, seen: int, sensor: str, expected: int) -> None:
        super().__init__(
            f"{path} has {seen} taxels per scan but sensor {sensor!r} has {expected}; "
            "choose the matching sensor with --sensor NAME or --sensor FILE.toml"
        )


class TimesNotIncreasing(RecordingError):
    """A time stamp is smaller than the previous one, or not finite."""

    def __init__(self, path: Path | str, scan: int, before_s: float, t_s: float) -> None:
        super().__init__(
            f"times in {path} do not increase: scan {scan} is at {t_s:.6f} s after {before_s:.6f} s; "
            "sort the recording by time (scans with a repeated stamp are dropped, decreasing stamps are not repaired)"
        )


class SensorNeeded(RecordingError):
    """The recording contains no sensor, and none was given."""

    def __init__(self, path: Path, known: Iterable[str]) -> None:
        super().__init__(
            f"{path} does not contain its sensor; add --sensor NAME ({', '.join(known)}) or --sensor FILE.toml"
        )


class TopicUnclear(RecordingError):
    """A bag has no suitable topic, or several."""

    def __init__(self, path: Path, seen: str, topics: Iterable[str]) -> None:
        listed = ", ".join(topics)
        remedy = f"choose one with --topic: {listed}" if listed else "the bag has no topics: record it again"
        super().__init__(f"cannot choose a topic of {path}: {seen}; {remedy}")


class SensorFileInvalid(TaxelflowError):
    """A sensor file violates the schema; the message names file, table and field."""

    def __init__(self, source: str, where: str, seen: str, remedy: str) -> None:
        super().__init__(f"sensor file {source}: {where}: {seen}; {remedy}")


class PitchNeeded(TaxelflowError):
    """The pitch of a built-in sensor is not published, and the user has not given it."""

    def __init__(self, name: str, seen: str) -> None:
        given = f"{seen!r} is not a pitch" if seen else "its pitch is not published"
        super().__init__(
            f"sensor {name}: {given}; measure it and add it to the name, as in {name}@3.0mm or {name}@3x2.5mm"
        )


class GridNameInvalid(TaxelflowError):
    """The name of a plain grid is malformed."""

    def __init__(self, name: str) -> None:
        super().__init__(
            f"{name!r} is not a plain grid; give rows, cols and pitch, as in grid:16x16@4mm or grid:4x7@10x10.6mm, "
            "and a unit if it is not counts, as in grid:16x16@4mm,kPa"
        )


class NameUnknown(TaxelflowError):
    """Nothing of this kind has that name. known: the names that exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        super().__init__(f"unknown {kind} {name!r}; known are {', '.join(known)}")


class ParameterInvalid(TaxelflowError):
    """A parameter is out of range. duty: what it must do, as in `be at least 2` or `end in .npz`."""

    def __init__(self, name: str, seen: object, duty: str) -> None:
        super().__init__(f"{name} must {duty} (got {seen!r})")


class ResultMissing(TaxelflowError):
    """A directory lacks a file that `taxelflow estimate` writes."""

    def __init__(self, directory: Path, lacks: str) -> None:
        super().__init__(f"{directory} holds no {lacks}; give a directory that `taxelflow estimate --out` has written")


class CalibrationError(TaxelflowError):
    """Gains cannot be estimated or used."""


class CalibrationInvalid(CalibrationError):
    """A calibration file violates the schema."""

    def __init__(self, path: Path | str, seen: str) -> None:
        super().__init__(f"calibration file {path}: {seen}; write it again with `taxelflow calibrate`")


class CalibrationUnfit(CalibrationError):
    """A calibration belongs to another sensor or method."""

    def __init__(self, made_for: str, used_for: str) -> None:
        super().__init__(
            f"the calibration is for {made_for}, not for {used_for}; "
            "use one that `taxelflow calibrate` has written for this sensor and method"
        )


class GainsUnknown(CalibrationError):
    """Recording and truth do not determine the gains."""

    def __init__(self, seen: str, remedy: str) -> None:
        super().__init__(f"gains cannot be estimated: {seen}; {remedy}")


class EstimatorBroken(TaxelflowError):
    """An estimator's session breaks its protocol."""

    def __init__(self, session: str, rows: int, scans: int) -> None:
        super().__init__(
            f"{session} gave estimates of {rows} scans where at most {scans} were waiting; "
            "its step must give one row per scan, in order, none twice"
        )


class TruthInvalid(TaxelflowError):
    """A robot's trajectory cannot be read."""

    def __init__(self, path: Path | str, seen: str) -> None:
        super().__init__(
            f"trajectory {path}: {seen}; give a csv with the header t_s,x_m,y_m or t_s,x_m,y_m,theta_rad and then rows "
            "of numbers in s, m, rad, with increasing times"
        )


class ExtraMissing(TaxelflowError):
    """An optional dependency is needed and not installed."""

    def __init__(self, extra: str, module: str) -> None:
        super().__init__(f"{module} is not installed; install it with: pip install 'taxelflow[{extra}]'")
