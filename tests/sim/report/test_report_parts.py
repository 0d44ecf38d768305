"""What a report is made of: frames, packed arrays and meshes, each small enough and true to what it shows."""

from __future__ import annotations

import base64
import io
import zlib

import numpy as np
import pytest
import trimesh
from PIL import Image

from sim.report.creases import creased
from sim.report.frames import frame_images
from sim.report.mesh_thinning import thinned
from sim.report.packing import Pack, add_mesh


def pictures_of(frames: dict[int, str]) -> dict[int, Image.Image]:
    return {
        step: Image.open(io.BytesIO(base64.b64decode(text.split(",")[1]))) for step, text in frames.items()
    }


def test_a_frame_looks_as_it_did_in_less_room(tmp_path) -> None:
    x, y = np.meshgrid(np.linspace(0, 255, 960), np.linspace(0, 255, 720))
    noise = np.random.default_rng(0).normal(0, 2, x.shape)
    scene = np.clip(np.stack([x, y, 127 + 60 * np.sin(x / 20)], axis=-1) + noise[..., None], 0, 255)
    scene = scene.astype(np.uint8)
    Image.fromarray(scene).save(tmp_path / "0001.png")
    ((_, text),) = frame_images(tmp_path, most_bytes=10_000_000).items()
    assert len(text) < (tmp_path / "0001.png").stat().st_size
    shown = np.asarray(pictures_of({1: text})[1].convert("RGB"), dtype=np.float64)
    assert np.sqrt(np.mean((shown - scene) ** 2)) < 4  # of 255


def test_frames_are_made_smaller_until_they_fit(tmp_path) -> None:
    noise = np.random.default_rng(0)
    for step in range(1, 9):
        Image.fromarray(noise.integers(0, 255, (240, 320, 3), dtype=np.uint8)).save(
            tmp_path / f"{step:04d}.png"
        )
    every = frame_images(tmp_path, most_bytes=10_000_000)
    assert list(every) == list(range(1, 9))
    assert pictures_of(every)[8].size == (320, 240)
    few = frame_images(tmp_path, most_bytes=200_000)
    assert sum(map(len, few.values())) <= 200_000
    assert max(few) == 8  # the last one is kept
    assert len(few) < 8
    assert frame_images(tmp_path / "none", most_bytes=100) == {}


def test_arrays_come_back_from_a_pack() -> None:
    pack, rng = Pack(), np.random.default_rng(0)
    arrays = [
        rng.integers(0, 100, 7).astype(np.uint8),
        rng.normal(size=5).astype(np.float32),
        np.arange(3, dtype=np.uint32),
    ]
    places = [pack.add(array) for array in arrays]
    content = zlib.decompress(base64.b64decode(pack.text()))
    for array, place in zip(arrays, places, strict=True):
        assert place["at"] % 8 == 0
        np.testing.assert_array_equal(np.frombuffer(content, place["kind"], place["n"], place["at"]), array)


def test_a_mesh_keeps_its_vertices_to_a_part_in_65535() -> None:
    pack, vertices = Pack(), np.random.default_rng(0).normal(size=(50, 3))
    mesh = add_mesh(pack, vertices, np.arange(48).reshape(-1, 3))
    content = zlib.decompress(base64.b64decode(pack.text()))
    fine = np.frombuffer(content, "uint16", mesh["vertices"]["n"], mesh["vertices"]["at"]).reshape(-1, 3)
    back = np.array(mesh["low"]) + fine * np.array(mesh["scale"])
    np.testing.assert_allclose(back, vertices, atol=np.ptp(vertices) / 65535)


@pytest.mark.parametrize("is_collapsed", [True, False])
def test_large_meshes_are_thinned_and_keep_their_place(monkeypatch, is_collapsed) -> None:
    if not is_collapsed:
        nothing = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)
        monkeypatch.setattr("fast_simplification.simplify", lambda *args, **kwargs: nothing)
    mesh = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    mesh.apply_translation([0.5, 0.0, 0.2])
    vertices, faces = thinned(np.asarray(mesh.vertices), np.asarray(mesh.faces), 20_000)
    assert 5_000 < len(faces) <= 20_000
    np.testing.assert_allclose(np.linalg.norm(vertices - [0.5, 0.0, 0.2], axis=1), 0.1, atol=0.002)
    assert thinned(mesh.vertices, mesh.faces, 10**6)[1] is mesh.faces


def test_a_ball_is_lit_smoothly_and_a_box_has_sharp_edges() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    vertices, normals, faces = creased(ball.vertices, ball.faces)
    assert len(vertices) == len(ball.vertices)
    np.testing.assert_allclose(normals, vertices / 0.1, atol=0.03)
    box = trimesh.creation.box()
    vertices, normals, faces = creased(box.vertices, box.faces)
    np.testing.assert_array_equal(vertices[faces], box.vertices[box.faces])
    np.testing.assert_allclose(normals[faces], np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-12)
    flat = np.array([[0, 1, 1]])
    assert np.isfinite(creased(box.vertices, flat)[1]).all()
