"""Devices with protocols of their own: XELA, Schunk DSA, BarrettHand, Inspire."""

from __future__ import annotations

import json
import socketserver
import struct
import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.devices import barrett, dsa, inspire, xela
from taxelflow.acquire.devices.frames import crc_table
from taxelflow.errors import AddressInvalid, ExtraMissing
from taxelflow.pipeline.live.emulators.base import POLL_S
from taxelflow.pipeline.live.emulators.streams import Pty
from taxelflow.runtime.endpoints import authority, family_of, listening, place_of

if TYPE_CHECKING:
    from typing import Self

    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_ASKED_S = 1.0
"""Time for which emulated pucks wait for a request."""


class WebSocketServer:
    """Sends messages to all who are connected. welcome: what each gets first."""

    welcome: tuple[str, ...] = ()

    def __init__(self, host: str, port: int) -> None:
        try:
            from websockets import exceptions
            from websockets.sync.server import serve
        except ImportError as error:
            raise ExtraMissing("devices", "websockets") from error
        self._serve: Any = serve
        self._closed: Any = exceptions.ConnectionClosed
        self._place = host, port
        self._clients: list[Any] = []
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        self._server = self._serve(self._talk, sock=listening(self._place))
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.port = self._server.socket.getsockname()[1]
        return self

    def __exit__(self, *_details: object) -> None:
        self._ended.set()
        time.sleep(POLL_S)
        self._server.shutdown()

    def wait(self) -> None:
        """See `Emulator`."""
        while not self._clients:
            time.sleep(POLL_S)

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        sent = False
        for client in list(self._clients):
            try:
                client.send(message.decode(errors="replace"))
                sent = True
            except self._closed:
                pass
        return sent

    def cut(self) -> None:
        """See `Emulator`."""
        for client in list(self._clients):
            client.socket.shutdown(2)

    def _talk(self, client: Any) -> None:
        for message in self.welcome:
            client.send(message)
        self.greet(client)
        self._clients.append(client)
        try:
            while not self._ended.is_set() and client.state == 1:
                time.sleep(POLL_S)
        finally:
            self._clients.remove(client)

    def greet(self, client: Any) -> None:
        """Read the first message of a client."""


class Xela(WebSocketServer):
    """XELA's server, with one sensor."""

    welcome = ('{"message":"Welcome"}',)

    def __init__(self, address: Address, _sensor: Sensor) -> None:
        super().__init__(address.host or "127.0.0.1", xela.PORT if address.port is None else address.port)
        self._count = 0

    @property
    def url(self) -> str:
        """See `Emulator`."""
        return f"xela://{authority(self._place[0], self.port)}"

    def encode(self, t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        self._count += 1
        numbers = ",".join(f"{max(0, round(value)):04X}" for value in np.nan_to_num(values).tolist())
        sensor = {"time": t_s, "sensor": "1", "model": "XR1944", "taxels": len(values) // 3, "data": numbers}
        return json.dumps({"message": self._count, "1": sensor}).encode()


class Dsa:
    """A DSACON32m on a pseudo-terminal; it sends when it has been asked to."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        self._table = crc_table(dsa.polynomial_of(address))
        self._cells, self._count = dsa.cells_of(sensor.layout)

    def __enter__(self) -> Self:
        self._pty = Pty()
        self.url = f"dsa:{self._pty.path}"
        return self

    def __exit__(self, *_details: object) -> None:
        self._pty.close()

    def wait(self) -> None:
        """See `Emulator`."""
        while dsa.PREAMBLE not in self._pty.received():
            time.sleep(POLL_S)

    def encode(self, t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        cells = np.zeros(self._count, np.int64)
        cells[self._cells[: len(values)]] = np.clip(np.round(np.nan_to_num(values)), 0, 4095)
        if len(values) < len(self._cells):
            cells = cells[:-1]
        starts = np.flatnonzero(np.concatenate([[True], np.diff(cells) != 0]))
        ends = np.append(starts[1:], len(cells))
        words: list[int] = []
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            whole, rest = divmod(end - start, 15)
            words += [15 << 12 | int(cells[start])] * whole + ([rest << 12 | int(cells[start])] if rest else [])
        head = dsa.SCAN_HEAD.pack(round(1e3 * t_s) & 0xFFFFFFFF, dsa.Flag.RUN_LENGTHS)
        return dsa.frame(dsa.Message.SCAN, head + np.array(words, "<u2").tobytes(), self._table)

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        return self._pty.send(message)

    def cut(self) -> None:
        """A pseudo-terminal cannot be unplugged and plugged in again under its path."""


class Barrett:
    """Four pucks on a CAN bus of python-can; `interface=virtual` is within one process, `udp_multicast` is not."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        self.url = address.url
        if (columns := sensor.channel_map.columns) != (held := len(barrett.PUCKS) * barrett.READINGS):
            seen = f"a scan has {columns} readings, and the hand {held}"
            raise AddressInvalid(address.url, seen, "--from a recording of barretthand-bh280-96")
        self._bus = barrett.CanBus(address.options.get("interface", "socketcan"), address.need_path("barrett-can:can0"))

    def __enter__(self) -> Self:
        self._bus.open()
        return self

    def __exit__(self, *_details: object) -> None:
        self._bus.shut()

    def wait(self) -> None:
        """See `Emulator`."""
        while not self._bus.asked(POLL_S):
            pass

    def encode(self, _t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        per_puck = np.array_split(values, len(barrett.PUCKS))
        return b"".join(
            barrett.frames_of(puck, np.resize(own, barrett.READINGS))
            for puck, own in zip(barrett.PUCKS, per_puck, strict=True)
        )

    def send(self, message: bytes) -> bool:
        """See `Emulator`: pucks send when all have been asked, and then once."""
        until, due = time.monotonic() + _ASKED_S, False
        while (puck := self._bus.asked(0.0 if due else POLL_S)) or not due:
            due = due or puck == barrett.PUCKS[-1]
            if not due and time.monotonic() >= until:
                return False
        whole = len(message) // barrett.CAN_FRAME.size * barrett.CAN_FRAME.size
        for identifier, content in barrett.CAN_FRAME.iter_unpack(message[:whole]):
            self._bus.send(identifier, content)
        return True

    def cut(self) -> None:
        """A bus stays."""


class _ModbusServer(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, place: tuple[str, int], answer: type[socketserver.BaseRequestHandler]) -> None:
        self.address_family = family_of(place[0])
        super().__init__(place, answer)


class Inspire:
    """A Modbus TCP server that answers reads of holding registers of one pad from the last scan."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        self._place = address.host or "127.0.0.1", inspire.MODBUS.port if address.port is None else address.port
        self._registers = np.zeros(sensor.channel_map.columns, np.int16)
        self._read = threading.Event()

    def __enter__(self) -> Self:
        hand = self

        class Answer(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                while len(head := self.rfile.read(12)) == 12:
                    number, _, _, unit, function, first, count = struct.unpack(">HHHBBHH", head)
                    body = struct.pack(">BB", unit, function) + hand._answer(first, count)
                    self.wfile.write(struct.pack(">HHH", number, 0, len(body)) + body)
                    hand._read.set()

        self._server = _ModbusServer(self._place, Answer)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.url = f"inspire-modbus://{place_of(self._server.socket)}"
        return self

    def __exit__(self, *_details: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, first: int, count: int) -> bytes:
        """Readings from a register on, up to the end of its pad, after the number of their bytes."""
        start = (first - inspire.MODBUS.first) // inspire.MODBUS.step
        ends = [end for end in np.cumsum(inspire.PADS).tolist() if end > start]
        end = min([start + count, *ends[:1]])
        values = self._registers[start:end].astype(">i2").tobytes()
        return struct.pack(">B", len(values)) + values

    def wait(self) -> None:
        """See `Emulator`."""
        self._read.wait()

    def encode(self, _t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        numbers = np.clip(np.round(np.nan_to_num(values)), -32768, 32767).astype(np.int16)
        return numbers.tobytes()

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        if len(message) == self._registers.nbytes:
            self._registers = np.frombuffer(message, np.int16)
        return True

    def cut(self) -> None:
        """See `Emulator`."""
