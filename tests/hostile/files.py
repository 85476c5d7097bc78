"""Hostile files of every format: the name says what each one tries. All have at most 20 MB."""

from __future__ import annotations

import bz2
import json
import sqlite3
import struct
import zipfile
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

from bagged import write_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

SENSOR = "grid:2x3@4mm"
"""Sensor that a recording without its own is read with."""
SENSORS = {"parquet_of_one_page_of_2_gb": "grid:1x1@4mm"}
SUFFIXES = {"npz": ".npz", "dsa": ".dsa", "mcap": ".mcap", "bag": ".bag", "db3": ".db3", "folder": "",
            "parquet": ".parquet", "csv": ".csv", "toml": ".toml"}  # fmt: skip
MAKERS: dict[str, Callable[[Path], Path]] = {}
"""Every file by the name of its function, `FORMAT_WHAT_IT_DOES`."""


def hostile(made: Callable[[Path], Path]) -> Callable[[Path], Path]:
    """Enter a function that writes a hostile file."""
    MAKERS[made.__name__] = made
    return made


_GIGABYTE = 1 << 30
_ZEROS = bytes(1 << 20)


def _npz(path: Path, members: dict[str, tuple[str, tuple[int, ...], int]], **texts: str) -> Path:
    """An archive whose arrays are zeros; members: type, shape declared, bytes of data."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, (kind, shape, size) in members.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array_header_1_0(member, {"descr": kind, "fortran_order": False, "shape": shape})
                if name == "t" and size < len(_ZEROS):
                    member.write((np.arange(shape[0]) / 100).tobytes())
                    continue
                for start in range(0, size, len(_ZEROS)):
                    member.write(_ZEROS[: size - start])
        for name, text in texts.items():
            with archive.open(f"{name}.npy", "w") as member:
                npy.write_array(member, np.array(text))
    return path


def _sensor(pads: int, rows: int, cols: int, **more: Any) -> str:
    pad = {"rows": rows, "cols": cols, "pitch_m": [0.001, 0.001]}
    return json.dumps(
        {"name": "s", "unit": "Pa", "pads": [{"name": f"p{n}", **pad, **more.get("pad", {})} for n in range(pads)]}
        | more.get("top", {})
    )


@hostile
def npz_with_a_billion_taxels(path: Path) -> Path:
    return _npz(path, {"t": ("<f8", (0,), 0), "pressure": ("<f8", (0, 4), 0)}, sensor=_sensor(1024, 1024, 1024))


@hostile
def npz_with_eight_contacts_on_each_pad(path: Path) -> Path:
    text = _sensor(128, 16, 16, pad={"contacts": 8})
    return _npz(path, {"t": ("<f8", (40,), 320), "pressure": ("<f8", (40, 32768), 40 * 8 * 32768)}, sensor=text)


@hostile
def npz_with_many_groups(path: Path) -> Path:
    groups = [{"name": f"g{n}", "patches": [{"pad": "p0"}] * 64} for n in range(1024)]
    text = _sensor(1, 128, 256, top={"groups": groups})
    return _npz(path, {"t": ("<f8", (0,), 0), "pressure": ("<f8", (0, 32768), 0)}, sensor=text)


@hostile
def npz_that_unpacks_to_6_gb(path: Path) -> Path:
    scans = 6 * _GIGABYTE // 48
    return _npz(path, {"t": ("<f8", (scans,), 8 * scans), "pressure": ("<f8", (scans, 6), 48 * scans // 8)})


@hostile
def npz_column_by_column(path: Path) -> Path:
    scans = 80 << 20
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, shape in (("t", (scans,)), ("pressure", (scans, 6))):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array_header_1_0(member, {"descr": "|u1", "fortran_order": True, "shape": shape})
                for _ in range(int(np.prod(shape)) >> 20):
                    member.write(_ZEROS)
    return path


@hostile
def npz_of_wide_scans(path: Path) -> Path:
    text = _sensor(1, 4, 4, pad={"channels": 1 << 20, "index": [*range(16)]}, top={"channels": 1 << 20})
    scans = 120
    return _npz(
        path, {"t": ("<f8", (scans,), 8 * scans), "pressure": ("|u1", (scans, 1 << 20), scans << 20)}, sensor=text
    )


@hostile
def npz_of_nested_json(path: Path) -> Path:
    text = '{"name":' + "[" * 100_000
    return _npz(path, {"t": ("<f8", (0,), 0), "pressure": ("<f8", (0, 4), 0)}, sensor=text)


@hostile
def npz_packed_by_bzip2(path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as archive:
        for name, shape in (("t", (1 << 24,)), ("pressure", (1 << 24, 6))):
            with archive.open(f"{name}.npy", "w") as member:
                npy.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": shape})
                for _ in range(128 * (len(shape) * 3 - 2) // 4):
                    member.write(_ZEROS)
    return path


def _dsa(path: Path, text: bytes, repeated: bytes = b"", times: int = 0, after: bytes = b"") -> Path:
    pack = bz2.BZ2Compressor()
    with path.open("wb") as file:
        file.write(pack.compress(text))
        for _ in range(times):
            file.write(pack.compress(repeated))
        file.write(pack.compress(after) + pack.flush())
    return path


@hostile
def dsa_of_one_long_text(path: Path) -> Path:
    return _dsa(path, b"<root><matrix><static_mask>", b" " * (1 << 24), 110)


@hostile
def dsa_of_empty_elements(path: Path) -> Path:
    return _dsa(path, b"<root>", b"<angle/>" * (1 << 20), 6)


@hostile
def dsa_of_a_deep_tree(path: Path) -> Path:
    return _dsa(path, b"<root>", b"<a>" * 100_000, 1)


@hostile
def dsa_of_entities(path: Path) -> Path:
    levels = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 10))
    return _dsa(path, f'<!DOCTYPE r [<!ENTITY e0 "aaaaaaaaaa">{levels}]><root><matrix>&e9;</matrix></root>'.encode())


@hostile
def dsa_of_a_huge_matrix(path: Path) -> Path:
    head = b'<root><matrix index="0"><cells_x>1024</cells_x><cells_y>1024</cells_y><texel_width>3</texel_width>'
    head += b"<texel_height>3</texel_height><fullscale>4095</fullscale>"
    masks = b"".join(b"<%s>" % name + b"1" * (1 << 20) + b"</%s>" % name for name in (b"static_mask", b"dynamic_mask"))
    return _dsa(path, head + masks + b"</matrix><frame></frame></root>")


_MAGIC = b"\x89MCAP0\r\n"
_UINT8 = "std_msgs/msg/UInt8MultiArray"
_STATE = "tactile_msgs/msg/TactileState"
_MULTI = (
    "std_msgs/MultiArrayLayout layout\nuint8[] data\n"
    + 80 * "="
    + "\nMSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
    + 80 * "="
    + "\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
)
_STATE_TEXT = (
    "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors\n"
    + 80 * "="
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + 80 * "="
    + "\nMSG: sensor_msgs/ChannelFloat32\nstring name\nfloat32[] values\n"
)


def _record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def mcap(
    path: Path, *records: bytes, schema: tuple[str, str] = (_UINT8, _MULTI), topics: tuple[str, ...] = ("/t",)
) -> Path:
    """An MCAP file without a summary: header, one schema, a channel per topic, then these records."""
    name, text = schema
    head = [
        _record(1, _text("ros2") + _text("")),
        _record(3, struct.pack("<H", 1) + _text(name) + _text("ros2msg") + _text(text)),
    ]
    for number, topic in enumerate(topics, 1):
        head.append(_record(4, struct.pack("<HH", number, 1) + _text(topic) + _text("cdr") + _text("")))
    tail = _record(15, bytes(4)) + _record(2, bytes(20)) + _MAGIC
    path.write_bytes(_MAGIC + b"".join(head) + b"".join(records) + tail)
    return path


def mcap_message(content: bytes, at_ns: int = 0, channel: int = 1) -> bytes:
    """The record of a message."""
    return _record(5, struct.pack("<HIQQ", channel, 0, at_ns, at_ns) + content)


def mcap_chunk(content: Iterable[bytes], compression: str, declared: int | None = None) -> bytes:
    """A chunk of these pieces, which may declare another size than they have."""
    import zstandard
    from lz4.frame import LZ4FrameCompressor

    pack: Any = zstandard.ZstdCompressor().compressobj() if compression == "zstd" else LZ4FrameCompressor()
    packed = [pack.begin()] if compression == "lz4" else []
    size = 0
    for piece in content:
        packed.append(pack.compress(piece))
        size += len(piece)
    data = b"".join([*packed, pack.flush()])
    head = struct.pack("<QQQI", 0, 0, size if declared is None else declared, 0) + _text(compression)
    return _record(6, head + struct.pack("<Q", len(data)) + data)


def _two_gigabytes() -> Iterable[bytes]:
    yield struct.pack("<BQHIQQ", 5, 2 * _GIGABYTE - 9, 1, 0, 0, 0)
    for _ in range(2 << 10):
        yield _ZEROS


@hostile
def mcap_of_a_2_gb_chunk_by_lz4(path: Path) -> Path:
    return mcap(path, mcap_chunk(_two_gigabytes(), "lz4"))


@hostile
def mcap_of_a_2_gb_chunk_by_zstd(path: Path) -> Path:
    return mcap(path, mcap_chunk(_two_gigabytes(), "zstd"))


@hostile
def mcap_that_declares_less_than_it_unpacks_to(path: Path) -> Path:
    return mcap(path, mcap_chunk(_two_gigabytes(), "lz4", declared=4096))


@hostile
def mcap_of_millions_of_small_messages(path: Path) -> Path:
    return mcap(path, *[mcap_chunk([mcap_message(b"") * 4_000_000], "zstd")] * 3)


@hostile
def mcap_of_a_large_message(path: Path) -> Path:
    parts = (
        struct.pack("<IIII", 256, 0, 0, 1 << 20)[:12]
        + struct.pack("<I", 1 << 20)
        + struct.pack("<III", 1, 0, 0) * (1 << 20)
    )
    message = mcap_message(struct.pack("<IIIII", 256, 0, 0, 1, 0) + parts)
    return mcap(path, mcap_chunk([message] * 8, "zstd"), schema=(_STATE, _STATE_TEXT))


@hostile
def mcap_of_long_arrays(path: Path) -> Path:
    text = _STATE_TEXT.replace("std_msgs/Header header", "std_msgs/Header header\nstring[100000000] junk")
    return mcap(path, mcap_message(bytes(64)), schema=(_STATE, text))


@hostile
def mcap_of_nested_json(path: Path) -> Path:
    metadata = _record(
        12, _text("taxelflow") + struct.pack("<I", 8 + 6 + 100_000) + _text("sensor") + _text("[" * 100_000)
    )
    message = mcap_message(struct.pack("<IdIxxxxd", 256, 0.0, 1, 0.0))
    return mcap(path, metadata, message, schema=("taxelflow_msgs/msg/Scan", "float64 t_s\nfloat64[] values\n"))


@hostile
def mcap_of_topics_that_clear_the_screen(path: Path) -> Path:
    message = struct.pack("<IIII", 256, 0, 0, 6) + bytes(6)
    topics = ("/\x1b[2Ja", "/\x1b]0;title\x07b")
    return mcap(path, mcap_message(message), mcap_message(message, channel=2), topics=topics)


def _bag(path: Path, compression: str, packed: bytes) -> Path:
    """A ROS 1 bag whose one chunk is replaced."""
    write_bag(path, {"/t": ("tactile_msgs/msg/TactileState", [[np.zeros(6)]] * 3)})
    out = bytearray(b"#ROSBAG V2.0\n")
    chunk_at = index_at = 0
    for header, data in bag_records(path.read_bytes()):
        kind = header[b"op"]
        if kind == b"\x05":
            chunk_at = len(out)
            out += bag_record({**header, b"compression": compression.encode()}, packed)
            continue
        if kind == b"\x07" and not index_at:
            index_at = len(out)
        moved = {**header, b"chunk_pos": struct.pack("<Q", chunk_at)} if kind == b"\x06" else header
        out += bag_record(moved, data)
    place = out.index(b"index_pos=") + len(b"index_pos=")
    out[place : place + 8] = struct.pack("<Q", index_at)
    path.write_bytes(out)
    return path


def bag_records(content: bytes) -> list[tuple[dict[bytes, bytes], bytes]]:
    """Header and data of each record of a ROS 1 bag."""
    found, place = [], 13
    while place < len(content):
        (size,) = struct.unpack_from("<I", content, place)
        header, at = {}, place + 4
        while at < place + 4 + size:
            (length,) = struct.unpack_from("<I", content, at)
            name, _, value = content[at + 4 : at + 4 + length].partition(b"=")
            header[name] = value
            at += 4 + length
        (length,) = struct.unpack_from("<I", content, at)
        found.append((header, content[at + 4 : at + 4 + length]))
        place = at + 4 + length
    return found


def bag_record(header: dict[bytes, bytes], data: bytes) -> bytes:
    """Bytes of a record."""
    fields = b"".join(struct.pack("<I", len(k) + len(v) + 1) + k + b"=" + v for k, v in header.items())
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


@hostile
def bag_of_a_2_gb_chunk_by_bz2(path: Path) -> Path:
    pack = bz2.BZ2Compressor()
    return _bag(path, "bz2", b"".join(map(pack.compress, [_ZEROS] * (2 << 10))) + pack.flush())


@hostile
def bag_of_a_2_gb_chunk_by_lz4(path: Path) -> Path:
    from lz4.frame import LZ4FrameCompressor

    pack = LZ4FrameCompressor()
    return _bag(path, "lz4", pack.begin() + b"".join(map(pack.compress, [_ZEROS] * (2 << 10))) + pack.flush())


@hostile
def db3_of_computed_rows(path: Path) -> Path:
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT);"
            "INSERT INTO topics VALUES (1, '/t', 'std_msgs/msg/UInt8MultiArray', 'cdr', '');"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
            " data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL);"
            "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1), (1, 2), (1, 3);"
        )
    return path


@hostile
def db3_of_topics_with_one_number(path: Path) -> Path:
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        row = (1, "/t", "std_msgs/msg/UInt8MultiArray", "cdr", "")
        database.executemany("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", [row] * 100_000)
        database.executemany("INSERT INTO messages VALUES (?, 1, ?, ?)", [(n, n, bytes(16)) for n in range(100_000)])
        database.commit()
    return path


@hostile
def folder_of_files_packed_by_zstd(path: Path) -> Path:
    import zstandard

    write_bag(path, {"/t": ("std_msgs/msg/UInt8MultiArray", [])}, storage="sqlite3")
    (file,) = path.glob("*.db3")
    text = (path / "metadata.yaml").read_text()
    text = text.replace('compression_format: ""', "compression_format: zstd").replace("''", '""')
    text = text.replace("compression_format: \n", "compression_format: zstd\n").replace(file.name, f"{file.name}.zstd")
    text = text.replace('compression_mode: ""', "compression_mode: FILE").replace(
        "compression_mode: \n", "compression_mode: FILE\n"
    )
    (path / "metadata.yaml").write_text(text)
    with (path / f"{file.name}.zstd").open("wb") as out, zstandard.ZstdCompressor().stream_writer(out) as packed:
        for _ in range(8 << 10):
            packed.write(_ZEROS)
    file.unlink()
    return path


@hostile
def folder_of_long_metadata(path: Path) -> Path:
    write_bag(path, {"/t": ("std_msgs/msg/UInt8MultiArray", [])}, storage="sqlite3")
    with (path / "metadata.yaml").open("a") as file:
        file.write("more: [" + "1, " * 5_000_000 + "]\n")
    return path


@hostile
def parquet_of_one_page_of_2_gb(path: Path) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = 120_000_000
    table = pa.table([pa.array(np.zeros(rows))] * 2, names=["t_s", "v0"])
    pq.write_table(
        table, path, compression="zstd", use_dictionary=False, data_page_size=(1 << 31) - 1, row_group_size=rows
    )
    return path


@hostile
def parquet_of_a_billion_equal_rows(path: Path) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, pa.float64()) for name in ("t_s", *(f"v{n}" for n in range(6)))])
    rows = pa.array(np.zeros(1 << 20))
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for _ in range(100):
            writer.write_table(pa.table([rows] * 7, schema=schema))
    return path


@hostile
def csv_of_ten_million_columns(path: Path) -> Path:
    path.write_text("t_s" + ",1" * 8_000_000 + "\n")
    return path


@hostile
def csv_of_one_endless_line(path: Path) -> Path:
    path.write_text("t_s,a,b,c,d,e,f\n0," + "1" * 18_000_000)
    return path


@hostile
def csv_of_quotes(path: Path) -> Path:
    path.write_text('t_s,a,b,c,d,e,f\n0,"' + '""' * 9_000_000)
    return path


@hostile
def toml_of_deep_tables(path: Path) -> Path:
    path.write_text("a = " + "[" * 50_000)
    return path


@hostile
def toml_of_a_long_key(path: Path) -> Path:
    path.write_text("a." * 500_000 + "a = 1")
    return path


@hostile
def toml_of_20_mb(path: Path) -> Path:
    path.write_text("gain = [" + "1," * 10_000_000 + "]")
    return path


@hostile
def toml_of_a_billion_taxels(path: Path) -> Path:
    pads = "".join(
        f'[[pads]]\nname = "p{n}"\nrows = 1024\ncols = 1024\npitch_m = [0.001, 0.001]\n' for n in range(1024)
    )
    path.write_text('name = "s"\nunit = "Pa"\n' + pads)
    return path


@hostile
def toml_of_many_curved_pads(path: Path) -> Path:
    rows = ",".join(f"[{0.001 * (n % 45)},{0.001 * (n // 45)},0,0,0,1]" for n in range(2000))
    pads = "".join(f'[[pads]]\nname = "p{n}"\ntaxels = [{rows}]\n' for n in range(4))
    path.write_text('name = "s"\nunit = "Pa"\n' + pads)
    return path


@hostile
def toml_whose_table_is_a_device(path: Path) -> Path:
    path.write_text('name = "s"\nunit = "Pa"\n[[pads]]\nname = "p"\ntaxels = "/dev/zero"\n')
    return path


@hostile
def toml_of_a_name_that_clears_the_screen(path: Path) -> Path:
    path.write_text('name = "a\\u001b[2Jb"\nunit = "Pa"\n[[pads]]\nname = "p"\nrows = 2\ncols = 3\npitch_m = [1, 1]\n')
    return path


@hostile
def toml_of_a_name_that_is_a_formula(path: Path) -> Path:
    path.write_text('name = "s"\nunit = "Pa"\n[[pads]]\nname = "=1+1"\nrows = 2\ncols = 3\npitch_m = [1, 1]\n')
    return path


def path_of(name: str, folder: Path) -> Path:
    """Where `make` writes the file of that name."""
    return folder / f"{name}{SUFFIXES[name.partition('_')[0]]}"


def make(name: str, folder: Path) -> None:
    """Write one of them into a folder."""
    MAKERS[name](path_of(name, folder))
