"""The tree of errors. Each message states what is wrong, what was seen, and what is allowed or what to do.

TaxelflowError
├── RecordingError            a recording cannot be used
│   ├── RecordingMissing      no such file
│   ├── RecordingsSeveral     more than one where one is taken
│   ├── RecordingsAlike       two whose results would have one name
│   ├── FormatUnknown         no reader for this file
│   ├── RecordingCorrupt      not of the format of its suffix, or damaged before the first scan
│   ├── RecordingTruncated    damaged after some scans, which were read
│   ├── TaxelCountWrong       the scans do not fit the sensor
│   ├── RecordingTooLarge     it would take more memory or time than its size explains
│   ├── TimesNotIncreasing    a time stamp decreases
│   ├── SensorNeeded          the recording contains no sensor and none was given
│   └── TopicUnclear          a bag has no suitable topic, or several
├── SensorFileInvalid         a sensor file violates the schema
├── PitchNeeded               a built-in sensor whose pitch the user has to give
├── GridNameInvalid           the name of a plain grid is malformed
├── NameUnknown               no sensor, estimator, ... of that name
├── WordsInvalid              words of the command line that a command cannot take
├── ParameterInvalid          a parameter is out of range
│   └── TipsOver              a simulated object does not stand
├── ResultMissing             a directory is not a result, or lacks a file
├── SourceMissing             the recording of a result is gone
├── CalibrationError          gains cannot be estimated or used
│   ├── CalibrationInvalid    a calibration file is invalid
│   ├── CalibrationUnfit      a calibration of another sensor or method
│   └── GainsUnknown          recording and truth do not determine the gains
├── BatchUnlike               a directory holds a batch with other settings
├── ClusterFault              workers or the scheduler failed; recordings are left undone
├── PluginBroken              a part of another package cannot be imported
├── PluginFailed              a part of another package raised an exception
├── EstimatorBroken           an estimator of another package breaks its protocol
├── RunEnded                  scans come after the end of a live run
├── TruthInvalid              a robot's trajectory cannot be read
├── AddressInvalid            the URL of a source or sink is malformed
├── SourceUnreachable         a source cannot be opened
├── SinkUnusable              a sink cannot be opened
├── PortTaken                 another program listens at a port
├── GraphicsMissing           pictures of the simulator cannot be rendered here
└── ExtraMissing              an optional dependency is not installed
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator


@dataclass(frozen=True, slots=True)
class _Message:
    """Size of a message."""

    names: int = 30
    """Names that a message lists at most."""
    characters: int = 4000
    """Characters of a message at most: it may quote what a file contains."""


_MESSAGE = _Message()
_PACKED = (".gz", ".bz2", ".xz", ".zst", ".zip", ".7z")
"""Suffixes of files that hold others."""
_PART = ".part"
"""Suffix of files until they are whole."""


def printable(text: str) -> str:
    """Text for one line of a terminal: characters that do not print, such as escapes, become `\\x1b`."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def nearest(name: str, known: Iterable[str]) -> str:
    """The question after the known name that is most like this one; empty if none is like it."""
    near = get_close_matches(str(name).lower(), list(known), n=1)
    return f"did you mean {near[0]!r}? " if near else ""


class TaxelflowError(Exception):
    """Root of all errors that taxelflow raises; the CLI prints them as one line."""

    def __init__(self, message: str) -> None:
        if len(message) > _MESSAGE.characters:
            message = f"{message[: _MESSAGE.characters // 2]} [...] {message[-_MESSAGE.characters // 2 :]}"
        super().__init__(printable(message))

    def __reduce__(self) -> tuple[Callable[..., TaxelflowError], tuple[object, ...]]:
        """As another process needs it: without what its kind takes to make one."""
        return _again, (type(self), self.args, self.__dict__)


def _again(kind: type[TaxelflowError], args: tuple[object, ...], fields: dict[str, object]) -> TaxelflowError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(fields)
    return error


@contextmanager
def written_at(place: Path | str) -> Iterator[None]:
    """Name the place in an OSError that has no file name, as one of a full disk, and the file that a `.part` was to
    become where there is no such `.part`.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(place)
        name = Path(error.filename2 or error.filename)
        if name != Path(place) and _PART in name.name and not name.exists():
            name = name.with_name("".join(name.name.rsplit(_PART, 1)))
        error.filename = str(name)
        del error.filename2  # of None it would print "-> None"
        raise


def holds_results(path: Path) -> bool:
    """Whether a path is a directory that `taxelflow estimate` has written."""
    return (path / "summary.json").is_file()


class RecordingError(TaxelflowError):
    """A recording cannot be used."""


class RecordingMissing(RecordingError):
    """There is no file or bag at the path."""

    def __init__(self, path: Path) -> None:
        if holds_results(path):
            super().__init__(f"{path} holds results, not a recording; give the recording that its summary.json names")
        elif path.is_dir():
            super().__init__(
                f"recording {path} is a directory, but not a ROS 2 bag (it has no metadata.yaml), and no pad has "
                "`files` in it; give one recording, use `taxelflow batch` for all recordings of a directory, or, for "
                "one file per pad, give --sensor and `files` of its pads or --columns.pads PAD=GLOB"
            )
        elif path.exists():
            super().__init__(f"recording {path} is a device or pipe; give the path of a regular file")
        else:
            super().__init__(f"recording {path} does not exist; give the path of a recording")


class RecordingsSeveral(RecordingError):
    """More than one recording where a command takes one."""

    def __init__(self, *paths: str) -> None:
        super().__init__(
            f"`taxelflow estimate` takes one recording, got {', '.join(paths)}; use `taxelflow batch` for several"
        )


class RecordingsAlike(RecordingError):
    """Two recordings of a batch whose results would be in one directory."""

    def __init__(self, one: Path | str, other: Path | str, directory: Path) -> None:
        super().__init__(
            f"the results of {one} and of {other} would both be in {directory}; rename one of them, or give it another "
            "--out"
        )


class FormatUnknown(RecordingError):
    """No reader or writer is registered for the file's suffix."""

    def __init__(self, path: Path, known: Iterable[str], part: str = "reader") -> None:
        seen = f"its suffix is {path.suffix!r}" if path.suffix else "it has no suffix"
        suffixes = [name for name in known if name.startswith(".")]
        unpack = "unpack it first; " if path.suffix in _PACKED and part == "reader" else ""
        super().__init__(f"no {part} for {path}: {seen}; {unpack}known are {', '.join(suffixes)}")


class RecordingCorrupt(RecordingError):
    """The content is not of the format of the suffix, or is damaged before the first scan."""

    def __init__(self, path: Path | str, seen: str, remedy: str) -> None:
        super().__init__(f"cannot read {path}: {seen}; {remedy}")


class RecordingTruncated(RecordingError):
    """The recording is incomplete; the scans before the damage have been delivered.

    read: number of these scans. expected: number that the file declares, None if unknown. seen: what the damage is.
    """

    def __init__(self, path: Path, read: int, expected: int | None, seen: str) -> None:
        self.read, self.expected, self.seen = read, expected, seen
        of = f" of {expected}" if expected is not None else ""
        super().__init__(f"{path} is truncated: {read}{of} scans could be read ({seen}); record or copy it again")


class TaxelCountWrong(RecordingError):
    """The number of taxels per scan differs from the sensor's."""

    def __init__(self, path: Path | str, seen: int, sensor: str, expected: int, remedy: str = "") -> None:
        """remedy: beside another sensor."""
        if expected == 3 * seen:
            remedy = "for readings of one axis give a sensor file without axes = 3"
        super().__init__(
            f"{path} has {seen} taxels per scan but sensor {sensor!r} has {expected}; "
            f"{remedy and f'{remedy}, or '}choose the matching sensor with --sensor NAME or --sensor FILE.toml"
        )


class RecordingTooLarge(RecordingError):
    """The recording would take more memory or time than its size in the file explains."""

    def __init__(self, path: Path | str, seen: str, remedy: str) -> None:
        super().__init__(f"{path} is refused: {seen}; {remedy}")


class TimesNotIncreasing(RecordingError):
    """A time stamp is smaller than the previous one, or not finite."""

    def __init__(self, path: Path | str, scan: int, before_s: float, t_s: float) -> None:
        seen = f"scan {scan} is at {t_s:.6f} s after {before_s:.6f} s"
        remedy = (
            "sort the recording by time (scans with a repeated stamp are dropped, decreasing stamps are not repaired)"
        )
        if not isfinite(t_s):
            seen, remedy = f"scan {scan} has no time ({t_s})", "leave out scans without a finite time"
        super().__init__(f"times in {path} do not increase: {seen}; {remedy}")


class SensorNeeded(RecordingError):
    """The recording or source contains no sensor, and none was given."""

    def __init__(self, path: Path | str, known: Iterable[str]) -> None:
        super().__init__(
            f"{path} does not contain its sensor; add --sensor NAME ({', '.join(known)}), "
            "a plain grid such as grid:16x16@4mm, or FILE.toml"
        )


class TopicUnclear(RecordingError):
    """A bag has no suitable topic, or several."""

    def __init__(
        self, path: Path, seen: str, topics: Iterable[str], option: str = "--topic", *, remedy: str = ""
    ) -> None:
        """remedy: where choosing another topic does not help."""
        names = list(topics)
        self._facts, self._remedy = (path, seen, names), remedy
        more = f" and {len(names) - _MESSAGE.names} more" if len(names) > _MESSAGE.names else ""
        listed = ", ".join(names[: _MESSAGE.names]) + more
        usual = f"choose one with {option}: {listed}" if listed else "the bag has no topics: record it again"
        does = f"its topics are {listed}; {remedy}" if remedy else usual
        super().__init__(f"cannot choose a topic of {path}: {seen}; {does}")

    def asked_by(self, option: str) -> TopicUnclear:
        """The same where another option chooses the topic."""
        return TopicUnclear(*self._facts, option, remedy=self._remedy)


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
        names = list(known)
        super().__init__(f"unknown {kind} {name!r}; {nearest(name, names)}known are {', '.join(names)}")


class WordsInvalid(TaxelflowError):
    """Words of the command line do not fit the command: one is missing, unknown, or not of its type."""


class ParameterInvalid(TaxelflowError):
    """A parameter is out of range. duty: what it must do, as in `be at least 2` or `end in .npz`."""

    def __init__(self, name: str, seen: object, duty: str) -> None:
        super().__init__(f"{name} must {duty} (got {seen!r})")
        self.name = name

    def on_command_line(self, words: Iterable[str]) -> str:
        """The message, with the parameter named by its option, with or without the unit of times, where that is among
        the words of a command.
        """
        names = f".{self.name}", f".{self.name.removesuffix('_s')}"
        for word in words:
            option = word.partition("=")[0]
            if option.startswith("--") and f".{option[2:].replace('-', '_')}".endswith(names):
                return f"{option}{str(self).removeprefix(self.name)}"
        return str(self)


class TipsOver(ParameterInvalid):
    """A simulated object does not stand: its load point is beside what carries it."""

    def __init__(self) -> None:
        super().__init__("object", "tips over", "have its load point over the part of the skin that carries it")


class ResultMissing(TaxelflowError):
    """A directory lacks a file that `taxelflow estimate` writes."""

    def __init__(
        self, directory: Path, lacks: str, remedy: str = "give a directory that `taxelflow estimate --out` has written"
    ) -> None:
        super().__init__(f"{directory} holds no {lacks}; {remedy}")


class SourceMissing(TaxelflowError):
    """A result's recording is needed, and is gone or has changed since."""

    def __init__(self, directory: Path, source: str) -> None:
        super().__init__(
            f"{directory} is the result of {source}, which is gone or has changed; "
            "restore it, or run `taxelflow estimate` again"
        )


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
            "use one by `taxelflow calibrate` for this sensor and method"
        )


class GainsUnknown(CalibrationError):
    """Recording and truth do not determine the gains."""

    def __init__(self, seen: str, remedy: str) -> None:
        self.why = f"{seen}; {remedy}"
        super().__init__(f"gains cannot be estimated: {self.why}")


class BatchUnlike(TaxelflowError):
    """A directory holds results of a batch with other settings. seen: which differ, and what they are."""

    def __init__(self, directory: Path, seen: str) -> None:
        super().__init__(
            f"{directory} holds results with other settings: {seen}; use the same settings, or another --out"
        )


class ClusterFault(TaxelflowError):
    """Workers or the scheduler of a batch failed; no recording is called failed for it."""

    def __init__(self, seen: str, remedy: str) -> None:
        super().__init__(f"{seen}; {remedy}")


class EstimatorBroken(TaxelflowError):
    """An estimator's session breaks its protocol."""

    def __init__(self, session: str, seen: str, remedy: str) -> None:
        super().__init__(f"{session} gave {seen}; {remedy}")


class RunEnded(TaxelflowError):
    """Scans come, or the end comes again, after the end of a run, which has closed slips and contacts."""

    def __init__(self) -> None:
        super().__init__("the run has ended with finish() and takes no more scans; make a new Live for further scans")


class TruthInvalid(TaxelflowError):
    """A robot's trajectory cannot be read."""

    def __init__(self, path: Path | str, seen: str) -> None:
        super().__init__(
            f"trajectory {path}: {seen}; give a csv with the header t_s,x_m,y_m or t_s,x_m,y_m,theta_rad and rows of "
            "numbers in s, m, rad, with increasing times; or a TUM file (.tum), or a bag with PoseStamped messages"
        )


class AddressInvalid(TaxelflowError):
    """The URL of a source or sink is malformed. form: what it should look like."""

    def __init__(self, url: str, seen: str, form: str) -> None:
        super().__init__(f"cannot use {url!r}: {seen}; give {form}")


class SourceUnreachable(TaxelflowError):
    """A source could not be opened in the time that is allowed. remedy: where waiting longer would not help."""

    def __init__(self, url: str, seen: str, waited_s: float, remedy: str = "") -> None:
        usual = "check that the device is on and the address is right, or wait longer with ?wait=SECONDS"
        tried = f" (tried for {waited_s:g} s)" if not remedy else ""
        super().__init__(f"cannot open {url}: {seen}{tried}; {remedy or usual}")


class SinkUnusable(TaxelflowError):
    """A sink could not be opened."""

    def __init__(self, url: str, seen: str, remedy: str = "check the path, permissions and port") -> None:
        super().__init__(f"cannot open {url}: {seen}; {remedy}")


class PortTaken(TaxelflowError):
    """A source or sink should listen at a port at which another program listens."""

    def __init__(self, url: str, port: int | None) -> None:
        taken = "its port" if port is None else f"port {port}"
        super().__init__(
            f"cannot open {url}: {taken} is taken by another program; choose another port, or end that program"
        )


class GraphicsMissing(TaxelflowError):
    """No way to render without a display. seen: what each way reported."""

    def __init__(self, seen: str) -> None:
        super().__init__(f"cannot render pictures: {seen}; install EGL (libegl1 with Mesa) or OSMesa (libosmesa6)")


class PluginBroken(TaxelflowError):
    """A part of another package cannot be imported, or breaks its protocol. error: what shows that."""

    def __init__(self, stage: str, name: str, where: str, package: str, error: Exception) -> None:
        seen = f"{type(error).__name__}: {' '.join(str(error).split())}"
        super().__init__(f"cannot use {stage} {name!r} from {where} ({seen}); repair or remove the package {package}")


class PluginFailed(TaxelflowError):
    """A part of another package raised what it should not. error, place: what, and where in the package."""

    def __init__(self, stage: str, name: str, package: str, error: BaseException, place: str) -> None:
        seen = f"{type(error).__name__}: {' '.join(str(error).split())}"
        super().__init__(
            f"{stage} {name!r} of the package {package} has failed ({seen}; {place}); repair or remove that package"
        )


class ExtraMissing(TaxelflowError):
    """An optional dependency is needed and not installed."""

    def __init__(self, extra: str, module: str) -> None:
        super().__init__(f"{module} is not installed; install it with: pip install 'taxelflow[{extra}]'")
