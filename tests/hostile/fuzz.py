"""Whole files, changed in their structure: what is inside a container is changed, and the container written anew.

A changed byte in a compressed file mostly breaks its checksum. So each format is taken apart, one of its parts is
changed, and it is put together again with valid sizes and checksums.
"""

from __future__ import annotations

import bz2
import os
import shutil
import struct
import tempfile
import time
import traceback
import zipfile
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import msgspec
import numpy as np

from bagged import write_bag
from hostile.files import bag_record, bag_records, mcap, mcap_chunk, mcap_message
from synthetic import DsaMatrix, grid_sensor, recorded, write_dsa
from tabled import GOOD
from taxelflow.acquire.columns import Columns
from taxelflow.errors import TaxelflowError
from taxelflow.pipeline.api import convert, read
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable

SENSOR = grid_sensor(2, 3)
VALUES = np.arange(240.0).reshape(40, 6)
_AT_ONCE = 60
"""Files that one process reads."""
_AT_MOST_S = 120
"""Processor time of such a process, s: what never ends is a finding, too."""
SLOW_S = 5.0
"""Processor time of a file of a few kB that counts as a finding."""
_WITH_SENSOR = (".npz", ".dsa", ".h5")
_INTERESTING = (0, 1, 0x7F, 0x80, 0xFF, 0x5B, 0x22, 0x2D)
_KEPT = Path(__file__).parent / "findings"


def changed(content: bytes, random: np.random.Generator) -> bytes:
    """Some bytes set, a piece doubled, moved or cut, or a number of 1 to 8 bytes made extreme."""
    spoiled = bytearray(content)
    for _ in range(int(random.integers(1, 4))):
        if not spoiled:
            break
        at = int(random.integers(len(spoiled)))
        size = int(random.choice([1, 2, 4, 8, 32]))
        way = int(random.integers(5))
        if way == 0:
            spoiled[at] = int(random.choice(_INTERESTING))
        elif way == 1:
            spoiled[at : at + size] = spoiled[at : at + size] * int(random.integers(2, 100))
        elif way == 2:
            del spoiled[at : at + size]
        elif way == 3:
            spoiled[at : at + size] = bytes([int(random.choice(_INTERESTING))]) * size
        else:
            spoiled[at] ^= 1 << int(random.integers(8))
    return bytes(spoiled)


def _npz(content: bytes, random: np.random.Generator) -> bytes:
    out = BytesIO()
    with zipfile.ZipFile(BytesIO(content)) as whole, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        names = whole.namelist()
        chosen = names[int(random.integers(len(names)))]
        for name in names:
            member = whole.read(name)
            packed.writestr(name, changed(member, random) if name == chosen else member)
    return out.getvalue()


def _dsa(content: bytes, random: np.random.Generator) -> bytes:
    return bz2.compress(changed(bz2.decompress(content), random))


def _bag(content: bytes, random: np.random.Generator) -> bytes:
    records = bag_records(content)
    chosen = int(random.integers(len(records)))
    out = b"#ROSBAG V2.0\n"
    for number, (header, data) in enumerate(records):
        if number != chosen:
            out += bag_record(header, data)
        elif random.integers(2):
            out += bag_record(header, changed(data, random))
        else:
            name = list(header)[int(random.integers(len(header)))]
            out += bag_record({**header, name: changed(header[name], random)}, data)
    return out


def _mcap(_content: bytes, random: np.random.Generator) -> bytes:
    scan = struct.pack("<IdI4x", 256, 0.0, 6) + bytes(48)
    messages = [mcap_message(changed(scan, random) if k == 3 else scan, k) for k in range(6)]
    compression = str(random.choice(["lz4", "zstd"]))
    declared = None if random.integers(2) else int(random.integers(1 << 40))
    inner = changed(b"".join(messages), random) if random.integers(2) else b"".join(messages)
    text = b"float64 t_s\nfloat64[] values\n"
    text = changed(text, random) if random.integers(2) else text
    with tempfile.TemporaryDirectory() as folder:
        path = mcap(
            Path(folder) / "a.mcap",
            mcap_chunk([inner], compression, declared),
            schema=("taxelflow_msgs/msg/Scan", text.decode(errors="replace")),
        )
        return path.read_bytes()


def _converted(suffix: str) -> Callable[[Path], bytes]:
    def write(folder: Path) -> bytes:
        path = folder / f"whole{suffix}"
        convert(recorded(VALUES, SENSOR), path)
        return path.read_bytes()

    return write


def _whole_bag(folder: Path) -> bytes:
    write_bag(folder / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", [[row] for row in VALUES])})
    content = (folder / "a.bag").read_bytes()
    (folder / "a.bag").unlink()
    return content


def _whole_dsa(folder: Path) -> bytes:
    return write_dsa(folder / "whole.dsa", VALUES, [DsaMatrix(2, 3)]).read_bytes()


def _whole_db3(folder: Path) -> bytes:
    write_bag(folder / "b", {"/t": ("tactile_msgs/msg/TactileState", [[row] for row in VALUES])}, storage="sqlite3")
    content = next((folder / "b").glob("*.db3")).read_bytes()
    shutil.rmtree(folder / "b")
    return content


def _whole_npy(folder: Path) -> bytes:
    np.save(folder / "a.npy", VALUES)
    return (folder / "a.npy").read_bytes()


def _whole_h5(folder: Path) -> bytes:
    with h5py.File(folder / "a.h5", "w") as file:
        file["t"], file.attrs["sensor"] = np.arange(40.0), msgspec.json.encode(SENSOR).decode()
        file.create_dataset("pressure", data=VALUES, compression="gzip", chunks=(8, 6))
    return (folder / "a.h5").read_bytes()


def _whole_toml(_folder: Path) -> bytes:
    return GOOD.encode()


FORMATS: dict[str, tuple[Callable[[Path], bytes], Callable[[bytes, np.random.Generator], bytes]]] = {
    ".npz": (_converted(".npz"), _npz),
    ".dsa": (_whole_dsa, _dsa),
    ".bag": (_whole_bag, _bag),
    ".mcap": (_converted(".mcap"), _mcap),
    ".csv": (_converted(".csv"), changed),
    ".parquet": (_converted(".parquet"), changed),
    ".db3": (_whole_db3, changed),
    ".npy": (_whole_npy, changed),
    ".h5": (_whole_h5, changed),
    ".toml": (_whole_toml, changed),
}
"""How a whole file of each format is made, and changed."""


def finding(path: Path) -> str:
    """What is wrong with how a file is read: an unforeseen error, a long time; empty if nothing is."""
    begin = time.process_time()
    try:
        if path.suffix == ".toml":
            load_sensor(str(path))
        else:
            columns = Columns(rate_hz=10.0) if path.suffix == ".npy" else None
            for _ in read(path, None if path.suffix in _WITH_SENSOR else SENSOR, columns=columns).blocks():
                pass
    except TaxelflowError as error:
        if not str(error).isprintable():
            return f"message with control characters: {error!r}"
    except Exception:  # that is what is looked for
        return traceback.format_exc()
    spent_s = time.process_time() - begin
    return f"{spent_s:.0f} s" if spent_s > SLOW_S else ""


def findings_of(paths: list[Path]) -> dict[Path, str]:
    """`finding` of several files in one process of their own, since a library may end it; only those that have any."""
    receive, send = os.pipe()
    child = os.fork()
    if not child:
        import resource  # not on Windows, which has no fork either

        resource.setrlimit(resource.RLIMIT_CPU, (_AT_MOST_S, _AT_MOST_S))
        with os.fdopen(send, "wb", buffering=0) as said:
            for number, path in enumerate(paths):
                said.write(struct.pack("<I", number))
                text = finding(path).encode(errors="replace")
                said.write(struct.pack("<I", len(text)) + text)
        os._exit(0)
    os.close(send)
    with os.fdopen(receive, "rb") as said:
        content = said.read()
    _, status = os.waitpid(child, 0)
    found, at, number = {}, 0, 0
    while at + 8 <= len(content):
        number, length = struct.unpack_from("<II", content, at)
        if length:
            found[paths[number]] = content[at + 8 : at + 8 + length].decode()
        at += 8 + length
    if os.WIFSIGNALED(status):
        (number,) = struct.unpack_from("<I", content, at)
        found[paths[number]] = f"ended by signal {os.WTERMSIG(status)}"
    return found


def fuzz(folder: Path, seconds: float, seed: int) -> int:
    """Change files for so many seconds; print and keep what is found. Returns the number of findings."""
    random = np.random.default_rng(seed)
    whole = {suffix: make(folder) for suffix, (make, _) in FORMATS.items()}
    tried = dict.fromkeys(FORMATS, 0)
    kinds: set[str] = set()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        paths = []
        for number in range(_AT_ONCE):
            suffix = list(FORMATS)[number % len(FORMATS)]
            paths.append(folder / f"{seed}-{tried[suffix]}{suffix}")
            paths[-1].write_bytes(FORMATS[suffix][1](whole[suffix], random))
            tried[suffix] += 1
        for path, said in findings_of(paths).items():
            kind = said.strip().splitlines()[-1][:120]
            if kind not in kinds:
                kinds.add(kind)
                _KEPT.mkdir(exist_ok=True)
                (_KEPT / path.name).write_bytes(path.read_bytes())
                print(f"{_KEPT / path.name}: {said}", flush=True)
        for path in paths:
            path.unlink()
    print(", ".join(f"{count} {suffix}" for suffix, count in tried.items()), f"changed: {len(kinds)} findings")
    return len(kinds)
