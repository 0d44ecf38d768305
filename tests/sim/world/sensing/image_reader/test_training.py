"""Training: masks are where lesions are, a few steps learn planted squares, and folding changes nothing."""

from argparse import Namespace

import numpy as np
import pytest

from benchmarks.image_reader_pictures import Examples, cells_of
from sim.world.sensing.image_reader.frames import N_COLUMNS, FrameGrid
from sim.world.sensing.image_reader.network import logits_of
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.label_grid import LabelGrid
from sim.world.sensing.ultrasound.tissues import TISSUES

GRID = FrameGrid.of(ConvexArray(depth_m=0.032))


def planted(rng: np.random.Generator) -> Examples:
    """Planes of noise with a dark square in each that is the lesion."""
    shape = (3, GRID.n_rows, N_COLUMNS)
    masks = np.zeros(shape, np.uint8)
    row, column = rng.integers(4, GRID.n_rows - 12), rng.integers(8, N_COLUMNS - 32)
    masks[:, row : row + 8, column : column + 24] = 4
    brightness = rng.normal(120.0, 10.0, shape) - 15.0 * masks
    return Examples(GRID, brightness.clip(0, 255).astype(np.uint8), masks, np.ones(shape, bool), 0.03)


def test_masks_are_the_share_of_each_cell_that_is_lesion():
    """A ball of 10 mm about a place of the plane, on a grid of 1 mm."""
    axes_m = 0.001 * np.arange(-20, 21)
    nodes_m = np.stack(np.meshgrid(axes_m, axes_m, axes_m, indexing="ij"))
    depth = (10.0 - 1e3 * np.linalg.norm(nodes_m, axis=0)).clip(-0.5, 0.5).astype(np.float32)
    labels = np.ones(depth.shape, np.uint8)
    tissue = LabelGrid.from_labels(
        (TISSUES["fat"], TISSUES["liver"]), labels, origin_m=np.full(3, -0.02), spacing_m=0.001
    )
    T = np.eye(4)
    T[2, 3] = -0.016
    masks, is_organ = cells_of(GRID, T[None], tissue, depth)
    rows, columns = np.meshgrid(np.arange(GRID.n_rows), np.arange(N_COLUMNS), indexing="ij")
    x_z_m = GRID.points_m(rows.astype(float), columns.astype(float))
    gap_m = np.hypot(x_z_m[..., 0], x_z_m[..., 1] - 0.016) - 0.010
    # A cell is 1 mm deep and at most 0.6 mm wide: beyond 0.8 mm of the outline it is all of one kind.
    assert (masks[0][gap_m < -0.0008] == 4).all()
    assert (masks[0][gap_m > 0.0008] == 0).all()
    assert is_organ[0][gap_m < 0.0].all()


def test_a_few_steps_learn_and_the_weights_answer_as_the_network_does():
    torch = pytest.importorskip("torch", reason="needs pip install 'sounding[train]'")
    from benchmarks.train_image_reader import calibrated, train

    rng = np.random.default_rng(0)
    examples = [planted(rng) for _ in range(8)]
    network = train(examples, Namespace(seed=0, steps=40))
    weights = calibrated(network, examples[:2], "a test")
    frames = planted(rng).frames
    answers = logits_of(weights, frames)
    with torch.no_grad():
        expected = network(torch.from_numpy(frames)).numpy()
    # Single precision, and another order of the sums.
    np.testing.assert_allclose(answers, expected, atol=1e-3 * np.abs(expected).max())
    called, truth = weights.scale * logits_of(weights, examples[3].frames) + weights.offset > 0.0, examples[3]
    is_lesion = truth.masks > 2
    assert 2.0 * (called & is_lesion).sum() / (called.sum() + is_lesion.sum()) > 0.8
