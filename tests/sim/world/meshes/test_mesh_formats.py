"""Mesh files as other programs write them: counts that are wrong, bytes too many, packed and quantised numbers."""

import base64
import json
import struct

import numpy as np
import pytest
import trimesh

from sim.world.errors import MeshError
from sim.world.meshes.meshes import load_mesh


def ball_mm(radius=50.0):
    return trimesh.creation.icosphere(subdivisions=3, radius=radius)


def binary(mesh=None):
    return (mesh or ball_mm()).export(file_type="stl")


def ascii_text(name="x"):
    return trimesh.exchange.stl.export_stl_ascii(ball_mm()).replace("solid \n", f"solid {name}\n", 1)


def counted(n):
    content = bytearray(binary())
    content[80:84] = struct.pack("<I", n)
    return bytes(content)


def load_bytes(path, content, **options):
    path.write_bytes(content)
    return load_mesh(path, **options)


N = 1280
READ = {
    "two bytes more": (binary() + b"\0\0", "2 bytes after its last triangle were left out"),
    "many bytes more": (binary() + bytes(997), "997 bytes after its last triangle were left out"),
    "a trailer of text": (binary() + b"made by a program" * 9, "153 bytes after its last triangle"),
    "no count": (counted(0), "its header counts 0 triangles, and the 1,280 that follow were read"),
    "too small a count": (
        counted(900),
        "its header counts 900 triangles, and the 1,280 that follow were read",
    ),
    "too large a count": (counted(1300), "its header counts 1,300 triangles, and the 1,280"),
    "an unknown count": (counted(0xFFFFFFFF), "its header counts 4,294,967,295 triangles"),
    "solid in a binary header": (b"solid by a program".ljust(80) + binary()[80:] + b"\0", "1 bytes after"),
    "no endsolid": (ascii_text().rpartition("endsolid")[0].encode(), "endsolid, is missing"),
    "Windows' line ends": (ascii_text().replace("\n", "\r\n").encode(), None),
    "old line ends": (ascii_text().replace("\n", "\r").encode(), None),
    "capitals": (ascii_text().upper().encode(), None),
    "a byte order mark": (b"\xef\xbb\xbf" + ascii_text().encode(), None),
    "a name with words of the format": (ascii_text("vertex facet solid").encode(), None),
    "a name in another encoding": (ascii_text("Läsion").encode("cp1252"), None),
}


@pytest.mark.parametrize("case", READ)
def test_what_holds_every_triangle_is_read_and_what_is_odd_is_said(tmp_path, case):
    content, said = READ[case]
    loaded = load_bytes(tmp_path / "organ.stl", content)
    assert loaded.solid.volume_m3 == pytest.approx(ball_mm().volume * 1e-9, rel=1e-5)
    assert len(loaded.solid.faces) == N
    assert len(loaded.notices) == (said is not None)
    assert said is None or said in loaded.notices[0]


CUT = {
    "within a vertex": ascii_text()[:40_003].encode(),
    "within a facet": ascii_text()[: ascii_text().index("endloop", 30_000)].encode(),
    "a binary one": binary()[:30_000],
    "a binary one between triangles": binary()[: 84 + 50 * 400],
}


@pytest.mark.parametrize("case", CUT)
def test_what_is_cut_is_called_so(tmp_path, case):
    with pytest.raises(MeshError, match="is cut short.*copy or export it again"):
        load_bytes(tmp_path / "organ.stl", CUT[case])


def gltf(vertices, faces, *, component, normalized=False, node=None, stride=None, uri=None, more=None):
    """A glTF tree and its buffer: positions of a component type, and indices."""
    dtype = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}[component]
    width = np.dtype(dtype).itemsize * 3
    stride = stride or width
    padded = np.zeros((len(vertices), stride), np.uint8)
    padded[:, :width] = (
        np.ascontiguousarray(vertices.astype(dtype)).view(np.uint8).reshape(len(vertices), width)
    )
    positions, indices = padded.tobytes(), faces.astype("<u4").tobytes()
    positions += bytes(-len(positions) % 4)
    view = {"buffer": 0, "byteLength": len(positions)} | ({"byteStride": stride} if stride != width else {})
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **(node or {})}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": component, "count": len(vertices), "type": "VEC3"}
            | ({"normalized": True} if normalized else {}),
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [view, {"buffer": 0, "byteOffset": len(positions), "byteLength": len(indices)}],
        "buffers": [{"byteLength": len(positions + indices)} | ({"uri": uri} if uri else {})],
    }
    return tree | (more or {}), positions + indices


def glb(tree, data):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize("component", [5120, 5121, 5122, 5123])
@pytest.mark.parametrize("normalized", [True, False])
@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_quantised_positions_are_brought_to_scale(tmp_path, component, normalized, kind):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    most = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}[component]
    is_signed = component in (5120, 5122)
    unit = ball.vertices if is_signed else (ball.vertices + 1.0) / 2.0
    scale = (0.06 if is_signed else 0.12) / (1 if normalized else most)
    shift = [0.0, 0.1, 0.2] if is_signed else [-0.06, 0.04, 0.14]
    tree, data = gltf(
        np.rint(unit * most),
        ball.faces,
        component=component,
        normalized=normalized,
        stride=8 if component > 5121 else 4,
        node={"scale": [scale] * 3, "translation": shift},
        more={"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]},
    )
    if kind == "gltf":
        tree["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    content = glb(tree, data) if kind == "glb" else json.dumps(tree).encode()
    solid = load_bytes(tmp_path / f"organ.{kind}", content, unit="m").solid
    # A step of the coarsest is 0.5 mm.
    assert solid.bounds_m.mean(axis=0) == pytest.approx([0.0, 0.1, 0.2], abs=0.5e-3)
    assert solid.volume_m3 == pytest.approx(ball.volume * 0.06**3, rel=0.02)


def test_compressed_triangles_are_refused_by_the_name_of_what_packed_them(tmp_path):
    ball = ball_mm(0.05)
    for name, word in {"KHR_draco_mesh_compression": "Draco", "EXT_meshopt_compression": "meshopt"}.items():
        tree, data = gltf(ball.vertices, ball.faces, component=5126)
        tree |= {"extensionsUsed": [name], "extensionsRequired": [name]}
        with pytest.raises(
            MeshError, match=rf"compressed by {word} \({name}\).*export it without compression"
        ):
            load_bytes(tmp_path / "organ.glb", glb(tree, data), unit="m")
    tree |= {"extensionsUsed": ["EXT_mesh_gpu_instancing"], "extensionsRequired": ["EXT_mesh_gpu_instancing"]}
    with pytest.raises(MeshError, match="needs EXT_mesh_gpu_instancing, which is not read"):
        load_bytes(tmp_path / "organ.glb", glb(tree, data), unit="m")


def test_compression_that_may_be_passed_over_is(tmp_path):
    ball = ball_mm(0.05)
    tree, data = gltf(ball.vertices, ball.faces, component=5126)
    tree |= {"extensionsUsed": ["KHR_draco_mesh_compression", "KHR_materials_unlit"]}
    tree |= {"extensionsRequired": ["KHR_materials_unlit"]}
    loaded = load_bytes(tmp_path / "organ.glb", glb(tree, data), unit="m")
    assert loaded.solid.volume_m3 == pytest.approx(ball.volume, rel=1e-5)


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        ("leber%20links.bin", "leber links.bin"),
        ("L%C3%A4sion.bin", "Läsion.bin"),
        ("plain.bin", "plain.bin"),
        ("100%.bin", "100%.bin"),
        ("leber links.bin", "leber links.bin"),
    ],
)
def test_a_buffers_address_is_percent_encoded_or_plain(tmp_path, uri, name):
    ball = ball_mm(0.05)
    tree, data = gltf(ball.vertices, ball.faces, component=5126, uri=uri)
    (tmp_path / name).write_bytes(data)
    loaded = load_bytes(tmp_path / "organ.gltf", json.dumps(tree).encode(), unit="m")
    assert loaded.solid.volume_m3 == pytest.approx(ball.volume, rel=1e-5)


def test_a_buffer_that_is_not_there_is_named(tmp_path):
    ball = ball_mm(0.05)
    tree, _ = gltf(ball.vertices, ball.faces, component=5126, uri="leber%20links.bin")
    with pytest.raises(MeshError, match=r"names a file 'leber links\.bin' with its points, which is not in"):
        load_bytes(tmp_path / "organ.gltf", json.dumps(tree).encode(), unit="m")


def test_a_gltf_file_with_a_byte_order_mark_is_read(tmp_path):
    ball = ball_mm(0.05)
    tree, data = gltf(ball.vertices, ball.faces, component=5126, uri="b.bin")
    (tmp_path / "b.bin").write_bytes(data)
    loaded = load_bytes(tmp_path / "organ.gltf", b"\xef\xbb\xbf" + json.dumps(tree).encode(), unit="m")
    assert loaded.solid.volume_m3 == pytest.approx(ball.volume, rel=1e-5)


def test_an_obj_file_with_a_byte_order_mark_or_in_another_encoding_is_read(tmp_path):
    text = "o Läsion\n" + ball_mm().export(file_type="obj")
    for content in (b"\xef\xbb\xbf" + text.encode(), text.encode("cp1252"), text.encode("utf-16")):
        loaded = load_bytes(tmp_path / "organ.obj", content)
        assert loaded.solid.volume_m3 == pytest.approx(ball_mm().volume * 1e-9, rel=1e-5)
