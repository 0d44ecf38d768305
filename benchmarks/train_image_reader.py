"""Trains the network of the reader of images on pictures of generated livers, and writes its weights.

    .venv/bin/pip install -e '.[ultrasound,train]'
    .venv/bin/python -m benchmarks.train_image_reader                       # the shipped weights
    .venv/bin/python -m benchmarks.train_image_reader --livers 2 --steps 50 --tuning 1 --out renders/weights.safetensors

First the pictures are drawn, those of each liver into a file of --pictures, which a second run finds there. Livers for
training have seeds from 100,000 on. The loss is the cross-entropy of the cells in the organ that the probe sees, plus
one minus the Dice, one half of it that of the batch and one half that of its planes with lesions. A batch has planes of
one depth, at random mirrored, in reversed order of planes, and with their brightness and contrast changed. What the
network answers is calibrated on the livers of seeds 1000 and following, on which it is not trained, by logistic
regression. The same seed gives the same numbers on one machine.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections import defaultdict
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch.nn import functional

from benchmarks.image_reader_network import Network
from benchmarks.image_reader_pictures import Examples, pictures_of
from sim.world.sensing.image_reader.network import logits_of
from sim.world.sensing.image_reader.weights import SHIPPED, ReaderWeights, save_weights

FIRST_SEED, FIRST_TUNING_SEED = 100_000, 1000
WIDTHS = (12, 24, 48, 64, 64)
BATCH = 16
RATE, DECAY = 3e-3, 1e-4
BESIDE = 0.05
"""What a cell counts that lies beside the organ or is not seen, against 1 of all others."""
LEAST_CELLS = 3.0
"""Cells of lesion that a plane has to have to be one with a lesion."""
REPORT_EVERY = 250


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--livers", type=int, default=22)
    parser.add_argument("--tuning", type=int, default=3, help="livers to calibrate on")
    parser.add_argument("--steps", type=int, default=4500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--pictures", type=Path, default=Path("renders/image-reader-pictures"))
    parser.add_argument("--out", type=Path, default=SHIPPED)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    start_s = perf_counter()
    examples = _pictures(range(FIRST_SEED, FIRST_SEED + options.livers), options.pictures)
    tuning = _pictures(range(FIRST_TUNING_SEED, FIRST_TUNING_SEED + options.tuning), options.pictures)
    print(f"pictures at hand after {(perf_counter() - start_s) / 60:.1f} min", flush=True)
    network = train(examples, options)
    trained = (
        f"{options.livers} generated livers from seed {FIRST_SEED}, {options.steps} steps of {BATCH} planes"
    )
    weights = calibrated(network, tuning, f"{trained}, seed {options.seed}")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    save_weights(weights, options.out)
    print(f"written to {options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


def _pictures(seeds: range, folder: Path) -> list[Examples]:
    return [each for seed in seeds for each in pictures_of(seed, folder)]


def train(examples: list[Examples], options: Namespace) -> Network:
    """The trained network."""
    torch.manual_seed(options.seed)
    rng = np.random.default_rng(options.seed)
    network = Network(WIDTHS).to(memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=options.steps, pct_start=0.05)
    groups = defaultdict(list)
    for each in examples:
        groups[each.grid.n_rows].append(each)
    sizes = np.array([len(group) for group in groups.values()], float)
    losses, clock_s, own_s = [], perf_counter(), process_time()
    for step in range(options.steps):
        group = list(groups.values())[int(rng.choice(len(groups), p=sizes / sizes.sum()))]
        frames, masks, counts = (torch.from_numpy(each) for each in _batch(group, rng))
        frames = frames.contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            answers = network(frames)
        loss = _loss(answers.float(), masks, counts)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        losses.append(loss.item())
        if (step + 1) % REPORT_EVERY == 0:
            print(
                f"step {step + 1}: loss {np.mean(losses[-REPORT_EVERY:]):.4f}, "
                f"{(perf_counter() - clock_s) / 60:.1f} min, {(process_time() - own_s) / 60:.1f} min of the processor",
                flush=True,
            )
    return network.eval()


def _batch(group: list[Examples], rng: np.random.Generator) -> tuple[NDArray[np.float32], ...]:
    """Planes with what lies in them, and what each cell counts, shapes (N, channels, rows, columns) and (N, ...)."""
    frames, masks, counts = [], [], []
    for _ in range(BATCH):
        each = group[int(rng.integers(len(group)))]
        plane = int(rng.integers(len(each.masks)))
        frame, mask, count = each.frames_of_plane(plane), each.masks[plane], each.counts[plane]
        if rng.random() < 0.5:
            frame[[0, 2]] = frame[[2, 0]]
        frame[:3] = frame[:3] * np.float32(rng.uniform(0.85, 1.15)) + np.float32(rng.normal(0.0, 0.15))
        is_mirrored = rng.random() < 0.5
        parts = (frame, mask.astype(np.float32) / 4.0, np.where(count, 1.0, BESIDE).astype(np.float32))
        for into, part in zip((frames, masks, counts), parts, strict=True):
            into.append(part[..., ::-1] if is_mirrored else part)
    return tuple(np.stack(each) for each in (frames, masks, counts))


def _loss(answers: torch.Tensor, masks: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Cross-entropy, times 10 since most cells are easy, plus what the Dice of batch and planes lack."""
    each = functional.binary_cross_entropy_with_logits(answers, masks, reduction="none")
    entropy = (each * counts).sum() / counts.sum()
    chance = torch.sigmoid(answers)
    both, sizes = (chance * masks * counts).sum((1, 2)), ((chance + masks) * counts).sum((1, 2))
    of_batch = (2.0 * both.sum() + 1.0) / (sizes.sum() + 1.0)
    # In the batch's a small lesion counts for little, in that of its plane as much as a large one.
    has_lesion = ((masks * counts).sum((1, 2)) > LEAST_CELLS).float()
    of_planes = (has_lesion * (2.0 * both + 1.0) / (sizes + 1.0)).sum() / has_lesion.sum().clamp(min=1.0)
    return 10.0 * entropy + 0.5 * (1.0 - of_batch) + 0.5 * (1.0 - of_planes)


def calibrated(network: Network, tuning: list[Examples], trained: str) -> ReaderWeights:
    """The weights of a network, with the line from its answers to log odds that explains the masks of livers best."""
    weights = ReaderWeights(
        arrays=network.arrays(), widths=WIDTHS, scale=1.0, offset=0.0, prior_log_odds=0.0, trained=trained
    )
    answers, masks = [], []
    for each in tuning:
        answers.append(logits_of(weights, each.frames)[each.counts])
        masks.append(each.masks[each.counts] / 4.0)
    answer, mask = np.concatenate(answers).astype(np.float64), np.concatenate(masks)

    def cross_entropy(line: NDArray[np.float64]) -> float:
        said = line[0] * answer + line[1]
        return float(np.mean(np.logaddexp(0.0, said) - mask * said))

    line = minimize(cross_entropy, np.array([1.0, 0.0]), method="Nelder-Mead").x
    prior = float(mask.mean())
    told = {
        "scale": float(line[0]),
        "offset": float(line[1]),
        "prior_log_odds": float(np.log(prior / (1.0 - prior))),
    }
    is_said, is_lesion = line[0] * answer + line[1] > 0.0, mask > 0.5
    overlap = 2.0 * (is_said & is_lesion).sum() / (is_said.sum() + is_lesion.sum())
    print(
        f"on the livers of calibration: Dice of cells {overlap:.3f}, cross-entropy {cross_entropy(line):.4f}, {told}"
    )
    return ReaderWeights(arrays=weights.arrays, widths=WIDTHS, trained=trained, **told)


if __name__ == "__main__":
    main()
