"""BarrettHand BH8-280 by CAN: `barrett-can:CHANNEL?interface=socketcan&rate=40`.

Each of four pucks (11 to 13: fingers, 14: palm) answers a request with 24 readings in five frames of 12-bit numbers, in
1/256 N/cm2. The protocol is that of RCPRG-ros-pkg/barrett_hand and libbarrett, which ask for each scan. Tested against
an emulator only.
"""

from __future__ import annotations

import struct
import time
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.devices.base import POLL_S, Faults
from taxelflow.acquire.devices.streams import PATIENCE, STREAM_OPTIONS, ByteSource, refuse_device_time
from taxelflow.errors import ExtraMissing, TaxelCountWrong
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor


class _Code(IntEnum):
    """Numbers of the pucks' protocol."""

    TACT = 106
    """The property that is set to ask for readings."""
    FULL = 2
    """Its value that asks for full readings."""
    GROUP = 9
    """CAN group to which pucks send full readings."""


PUCKS = range(11, 15)
"""Numbers of the pucks on the bus, in the order of the readings: of three fingers, and of the palm."""


@dataclass(frozen=True, slots=True)
class _Puck:
    """What a puck sends."""

    frames: int = 5
    per_frame: int = 5
    """Frames that carry the readings of a puck, and numbers in a frame."""
    per_n_cm2: float = 256.0
    """Counts in a pressure of 1 N/cm2."""


PUCK = _Puck()
READINGS = PUCK.frames * PUCK.per_frame - 1
"""Of a puck: the last number of the last frame is padding."""
_RATE = 40.0
"""Default scans/s."""
CAN_FRAME = struct.Struct(">H8s")
"""A frame as the transport passes it on: its identifier and its 8 bytes."""


def frames_of(puck: int, readings: Floats) -> bytes:
    """The frames of a puck's 24 readings in N/cm2."""
    counts = np.clip(np.round(np.nan_to_num(readings) * PUCK.per_n_cm2), 0, 4095).astype(int)
    frames = []
    for sequence, numbers in enumerate(np.append(counts, 0).reshape(PUCK.frames, PUCK.per_frame).tolist()):
        word = sequence
        for number in numbers:
            word = word << 12 | number
        frames.append(CAN_FRAME.pack(0x400 | puck << 5 | _Code.GROUP, word.to_bytes(8, "big")))
    return b"".join(frames)


def ask(puck: int) -> tuple[int, bytes]:
    """Identifier and bytes of the message that asks a puck for full readings."""
    return puck, struct.pack("<BBi", 0x80 | _Code.TACT, 0, _Code.FULL)


ASKED = CAN_FRAME.pack(*ask(PUCKS[0]))
"""What the transport passes on where it has asked for a scan: readings before and after it are never joined."""


def _puck_of(identifier: int) -> int:
    """The puck whose readings a frame carries; 0 for another frame."""
    return identifier >> 5 & 0x1F if identifier & 0x41F == 0x400 | _Code.GROUP else 0


class BarrettParser:
    """Joins frames to readings, and what four pucks answer to one request to a scan; of a puck that is silent they are
    missing.
    """

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self.restart()

    def restart(self) -> None:
        """See `Parser`."""
        self._parts: dict[int, list[int]] = {}
        self._scan: dict[int, Floats] = {}

    def end(self) -> list[tuple[float | None, Floats]]:
        """See `Parser`."""
        self.restart()
        return []

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `Parser`: whole frames by `CAN_FRAME`."""
        scans: list[tuple[float | None, Floats]] = []
        for identifier, content in CAN_FRAME.iter_unpack(received[: len(received) // CAN_FRAME.size * CAN_FRAME.size]):
            if identifier == PUCKS[0]:  # see ASKED
                if 0 < len(self._scan) < len(PUCKS):
                    self._faults.count("puck silent", f"of {len(PUCKS)}, {len(self._scan)} have sent")
                    scans.append((None, self._values()))
                self._scan = {}
            puck = _puck_of(identifier)
            if puck not in PUCKS or len(self._scan) == len(PUCKS):
                continue
            readings = self._joined(puck, int.from_bytes(content, "big"))
            if readings is None:
                continue
            self._scan[puck] = readings
            if len(self._scan) == len(PUCKS):
                scans.append((None, self._values()))
        return scans

    def _joined(self, puck: int, word: int) -> Floats | None:
        """A puck's readings, when the last of its frames has come."""
        sequence = word >> 60
        numbers = self._parts.setdefault(puck, [])
        count = PUCK.per_frame
        own = [word >> 12 * (count - 1 - k) & 0xFFF for k in range(count)]
        if (sequence + 1) * count == len(numbers) and numbers[-count:] == own:  # a frame that came twice
            return None
        if sequence * count != len(numbers):
            self._faults.count("frame out of sequence", f"{sequence} of puck {puck}")
            numbers.clear()
        if sequence * count == len(numbers) and sequence < PUCK.frames:
            numbers += own
        if len(numbers) < PUCK.frames * count:
            return None
        del self._parts[puck]
        return np.array(numbers[:READINGS]) / PUCK.per_n_cm2

    def _values(self) -> Floats:
        missing = np.full(READINGS, np.nan)
        values: Floats = np.concatenate([self._scan.get(puck, missing) for puck in PUCKS])
        return values


class CanBus:
    """A bus of python-can. The pucks are asked for the next scan when its time has come and the last one is there, or
    late.
    """

    patient = False
    timeout_s = PATIENCE.timeout_s

    def __init__(self, interface: str, channel: str, rate_hz: float = _RATE) -> None:
        try:
            import can
        except ImportError as error:
            raise ExtraMissing("devices", "python-can") from error
        self._can: Any = can
        self._interface, self._channel, self._period_s = interface, channel, 1 / rate_hz
        self._bus: Any = None
        self._asked_s = self._due_s = float("-inf")
        self._left, self._asked = 0, b""

    def listen(self) -> None:
        """Nothing waits for a peer."""

    def open(self) -> bool:
        """See `Transport`."""
        try:
            self._bus = self._can.Bus(interface=self._interface, channel=self._channel)
        except (self._can.CanError, NotImplementedError, ValueError) as error:
            raise OSError(str(error)) from error
        self._due_s = float("-inf")
        return True

    def send(self, identifier: int, content: bytes) -> None:
        """Send a frame, whose identifier has 11 bits. Raises OSError."""
        message = self._can.Message(arbitration_id=identifier & 0x7FF, data=content, is_extended_id=False)
        self._bus.send(message)

    def receive(self) -> bytes:
        """See `Transport`."""
        if time.monotonic() >= self._due_s:
            self._ask()
        try:
            message = self._bus.recv(min(max(self._due_s - time.monotonic(), 0.0), POLL_S))
        except self._can.CanError as error:
            raise OSError(str(error)) from error
        if message is None or len(message.data) != 8:
            return b""
        if _puck_of(message.arbitration_id) in PUCKS:
            self._left -= 1
            if not self._left:
                self._due_s = self._asked_s + self._period_s
        asked, self._asked = self._asked, b""  # not before an answer: a silent bus must be found silent
        return asked + CAN_FRAME.pack(message.arbitration_id & 0xFFFF, bytes(message.data))

    def _ask(self) -> None:
        try:
            for puck in PUCKS:
                identifier, content = ask(puck)
                self.send(identifier, content)
        except self._can.CanError as error:
            raise OSError(str(error)) from error
        self._asked_s, self._left, self._asked = time.monotonic(), PUCK.frames * len(PUCKS), ASKED
        self._due_s = self._asked_s + max(POLL_S, self._period_s)

    def asked(self, wait_s: float) -> int:
        """The puck that has been asked for readings, as an emulated one waits for; 0 if none."""
        try:
            message = self._bus.recv(wait_s)
        except self._can.CanError:  # what another program sends
            return 0
        return 0 if message is None or message.arbitration_id not in PUCKS else int(message.arbitration_id)

    def close(self) -> None:
        """See `Transport`."""
        bus, self._bus = self._bus, None
        if bus is not None:
            with suppress(OSError, self._can.CanError):  # an adapter that was pulled
                bus.shutdown()

    def shut(self) -> None:
        """See `Transport`."""
        self.close()


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`barrett-can:CHANNEL?interface=socketcan&rate=40`. Raises AddressInvalid, TaxelCountWrong, ExtraMissing."""
    address.check_options((*STREAM_OPTIONS, "interface", "rate"))
    channel = address.need_path("barrett-can:can0")
    refuse_device_time(address)
    sensor, faults = sensor or load_sensor("barretthand-bh280-96"), Faults()
    if sensor.channel_map.columns != len(PUCKS) * READINGS:
        raise TaxelCountWrong("the hand", len(PUCKS) * READINGS, sensor.name, sensor.channel_map.columns)
    bus = CanBus(address.options.get("interface", "socketcan"), channel, address.number("rate", _RATE, 0.1))
    return ByteSource(address, sensor, bus, BarrettParser(faults), faults)
