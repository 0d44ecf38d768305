"""Segments that overlap, which 3D Slicer saves on layers: each comes out whole."""

import numpy as np
import pytest
from scanned_ball import CENTRE_MM, RADIUS_MM, TUMOUR_MM, TUMOUR_RADIUS_MM, assert_is_the_ball, grid, load

from sim.cli.command_line import main
from sim.world.errors import VolumeError
from sim.world.volumes.files import load_volume


def balls():
    """The whole ball, the tumour in it and a vein through it, as masks on one grid."""
    T, shape = grid()
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T[:3, :3].T + T[:3, 3]
    liver = np.linalg.norm(points_mm - CENTRE_MM, axis=-1) < RADIUS_MM
    tumour = np.linalg.norm(points_mm - TUMOUR_MM, axis=-1) < TUMOUR_RADIUS_MM
    vein = np.linalg.norm((points_mm - CENTRE_MM)[..., :2], axis=-1) < 9.0
    return T, shape, liver, tumour, vein


def save_layers(path, layers, segments, *, layer_axis=0, kinds=True):
    """A file of four axes as Slicer writes it; segments are (name, value, layer)."""
    T, *_ = balls()
    data = np.stack(layers, axis=layer_axis).astype(np.uint8)
    directions = [f"({','.join(str(x) for x in column)})" for column in T[:3, :3].T]
    directions.insert(layer_axis, "none")
    words = ["domain"] * 3
    words.insert(layer_axis, "list")
    lines = ["NRRD0005", "type: uchar", "dimension: 4", "space: left-posterior-superior"]
    lines += [f"sizes: {' '.join(map(str, data.shape))}", f"space directions: {' '.join(directions)}"]
    lines += [f"kinds: {' '.join(words)}"] if kinds else []
    lines += ["encoding: raw", f"space origin: ({','.join(str(x) for x in T[:3, 3])})"]
    for index, (name, value, layer) in enumerate(segments):
        lines += [f"Segment{index}_Name:={name}", f"Segment{index}_LabelValue:={value}"]
        lines += [f"Segment{index}_Layer:={layer}"]
    path.write_bytes("\n".join([*lines, "", ""]).encode() + data.tobytes(order="F"))
    return path


@pytest.mark.parametrize("layer_axis", [0, 3])
@pytest.mark.parametrize("kinds", [True, False])
def test_each_segment_is_whole_where_they_overlap(tmp_path, layer_axis, kinds):
    _, _, liver, tumour, vein = balls()
    segments = [("Liver", 1, 0), ("Tumor", 1, 1), ("Portal vein", 2, 1)]
    layers = [liver * 1, np.where(tumour, 1, vein * 2)]
    path = save_layers(tmp_path / "case.seg.nrrd", layers, segments, layer_axis=layer_axis, kinds=kinds)
    volume = load_volume(path)
    assert volume.label_names == {1: "Liver", 2: "Tumor", 3: "Portal vein"}
    assert volume.counts == {1: liver.sum(), 2: tumour.sum(), 3: (vein & ~tumour).sum()}
    loaded = load(path)
    assert_is_the_ball(loaded)  # the vein through it took nothing of it
    assert [structure.name for structure in loaded.structures] == ["Portal vein"]
    assert any("2 layers and are numbered anew: 1 'Liver', 2 'Tumor'" in notice for notice in loaded.notices)


def test_three_layers_that_overlap_in_every_way_are_told_apart(tmp_path):
    rng = np.random.default_rng(0)
    shape = balls()[1]
    masks = [rng.uniform(size=shape) < 0.4 for _ in range(3)]
    segments = [(f"s{n}", n + 4, n) for n in range(3)]
    layers = [mask * (n + 4) for n, mask in enumerate(masks)]
    volume = load_volume(save_layers(tmp_path / "case.seg.nrrd", layers, segments))
    for number, mask in enumerate(masks, start=4):  # one number a segment in the whole file: it is kept
        assert np.array_equal(np.isin(volume.labels, volume.numbers_of((number,))), mask[volume.box])
        assert volume.counts[number] == mask.sum()


def test_one_layer_of_four_axes_is_read(tmp_path):
    _, _, liver, tumour, _ = balls()
    segments = [("Liver", 1, 0), ("Tumor", 2, 0)]
    assert_is_the_ball(load(save_layers(tmp_path / "a.seg.nrrd", [np.where(tumour, 2, liver * 1)], segments)))
    assert_is_the_ball(load(save_layers(tmp_path / "b.nrrd", [np.where(tumour, 2, liver * 1)], [])))


def test_layers_without_segments_are_no_labels(tmp_path):
    _, _, liver, tumour, _ = balls()
    with pytest.raises(VolumeError, match="has 4 axes"):
        load_volume(save_layers(tmp_path / "case.nrrd", [liver * 1, tumour * 1], []))


def test_numbers_that_no_segment_names_get_a_name(tmp_path):
    _, _, liver, tumour, _ = balls()
    path = save_layers(tmp_path / "case.seg.nrrd", [liver * 1, tumour * 7], [("Liver", 1, 0)])
    assert load_volume(path).label_names == {1: "Liver", 2: "layer 1, 7"}


def test_inspect_counts_each_segment_whole(tmp_path, capsys):
    _, _, liver, tumour, _ = balls()
    segments = [("Liver", 1, 0), ("Tumor", 1, 1)]
    path = save_layers(tmp_path / "case.seg.nrrd", [liver * 1, tumour * 1], segments)
    assert main(["inspect", str(path), "--out", str(tmp_path / "p.png")]) == 0
    printed = capsys.readouterr().out
    assert f"{liver.sum():,}" in printed
    assert "tumours: 1, " in printed
