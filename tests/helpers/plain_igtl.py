"""OpenIGTLink by the letter of its specification, on nothing but sockets: an oracle of what we send and take."""

import socket
import struct
import time
from contextlib import suppress

import numpy as np

HEADER = ">H12s20sIIQQ"  # http://openigtlink.org/protocols/v2_header.html
HEADER_BYTES = 58


def crc64(data: bytes) -> int:
    """CRC-64 of ECMA-182, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 56
        for _ in range(8):
            crc = ((crc << 1) ^ 0x42F0E1EBA9EA3693) & 0xFFFFFFFFFFFFFFFF if crc >> 63 else crc << 1
    return crc


def packed(
    kind: str, device: str, body: bytes, *, stamp_s: float | None = None, crc: int | None = None, size=None
):
    """A message; 0 s is what senders write that know no time."""
    stamp_s = time.time() if stamp_s is None else stamp_s
    fraction = int((stamp_s % 1.0) * 2**32)
    return (
        struct.pack(
            HEADER,
            1,
            kind.encode(),
            device.encode(),
            int(stamp_s),
            fraction,
            len(body) if size is None else size,
            crc64(body) if crc is None else crc,
        )
        + body
    )


def transform(device: str, T: np.ndarray, **more) -> bytes:
    """A TRANSFORM: three columns of the rotation, then the place."""
    return packed("TRANSFORM", device, struct.pack(">12f", *T[:3, :4].T.ravel()), **more)


def image(device: str, labels: np.ndarray, T_index: np.ndarray, *, is_lps=False, **more) -> bytes:
    """An IMAGE of bytes, labels of shape (I, J, K); i runs fastest, and the place is that of the centre."""
    centre = T_index @ [*((n - 1) / 2 for n in labels.shape), 1.0]
    body = struct.pack(">HBBBB3H", 1, 1, 3, 2, 2 if is_lps else 1, *labels.shape)
    body += struct.pack(">12f", *T_index[:3, :3].T.ravel(), *centre[:3])
    body += struct.pack(">6H", 0, 0, 0, *labels.shape)
    return packed("IMAGE", device, body + labels.astype(np.uint8).tobytes(order="F"), **more)


def points(device: str, positions: np.ndarray, groups: list[str], **more) -> bytes:
    """A POINT."""
    body = b"".join(
        struct.pack(">64s32s4B3ff20s", b"", group.encode(), 0, 0, 0, 255, *place, 0.0, b"")
        for place, group in zip(positions, groups, strict=True)
    )
    return packed("POINT", device, body, **more)


class PlainClient:
    """A client that reads one message after the other."""

    def __init__(self, port: int):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20.0)

    def exactly(self, n: int) -> bytes:
        data = b""
        while len(data) < n:
            chunk = self.socket.recv(n - len(data))
            if not chunk:
                raise ConnectionError("the server has left")
            data += chunk
        return data

    def receive(self) -> tuple[str, str, bytes]:
        """Kind, device and body of the next message, whose checksum is right."""
        version, kind, device, _, _, size, crc = struct.unpack(HEADER, self.exactly(HEADER_BYTES))
        body = self.exactly(size)
        assert version == 1
        if size < 5000:  # bit by bit is slow
            assert crc == crc64(body)
        return kind.rstrip(b"\0").decode(), device.rstrip(b"\0").decode(), body

    def wait_for(self, device: str, accept=lambda body: True) -> tuple[str, bytes]:
        """Kind and body of the next message of a device that is accepted."""
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            kind, name, body = self.receive()
            if name == device and accept(body):
                return kind, body
        raise TimeoutError(device)

    def end(self):
        """Say that nothing more is sent, and go when the server has, so that all that was sent has been read."""
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_WR)
            while self.socket.recv(2**16):
                pass
        self.close()

    def close(self):
        self.socket.close()


def matrix_of(body: bytes) -> np.ndarray:
    """The pose of a TRANSFORM."""
    T = np.eye(4)
    T[:3, :4] = np.array(struct.unpack(">12f", body)).reshape(4, 3).T
    return T


def image_of(body: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The bytes of an IMAGE in RAS, shape (I, J, K), and its map from indices to RAS [mm]."""
    version, n_components, scalar, _, axes, *shape = struct.unpack(">HBBBB3H", body[:12])
    assert (version, n_components, scalar, axes) == (1, 1, 3, 1)
    T = np.eye(4)
    numbers = np.array(struct.unpack(">12f", body[12:60])).reshape(4, 3)
    T[:3, :3] = numbers[:3].T
    T[:3, 3] = numbers[3] - T[:3, :3] @ [(n - 1) / 2 for n in shape]
    return np.frombuffer(body[72:], dtype=np.uint8).reshape(shape, order="F"), T


def surface_of(body: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a POLYDATA of triangles."""
    n_points, *_ = header = struct.unpack(">10I", body[:40])
    n_cells, cell_bytes = header[5], header[6]
    places = np.frombuffer(body[40 : 40 + 12 * n_points], dtype=">f4").reshape(-1, 3)
    cells = np.frombuffer(body[40 + 12 * n_points :], dtype=">u4")
    assert len(cells) * 4 == cell_bytes
    cells = cells.reshape(n_cells, 4)
    assert (cells[:, 0] == 3).all()
    return places.astype(float), cells[:, 1:].astype(int)
