"""The network's layers against plain correlations, and the file of its weights with all that can be wrong with one."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.ndimage import correlate

from sim.errors import FieldError
from sim.world.sensing.image_reader.frames import N_CHANNELS
from sim.world.sensing.image_reader.network import logits_of
from sim.world.sensing.image_reader.weights import (
    SHIPPED,
    ReaderWeights,
    load_weights,
    save_weights,
    shapes_of,
)

WIDTHS = (4, 8, 12)


@pytest.fixture(scope="module")
def weights() -> ReaderWeights:
    rng = np.random.default_rng(0)
    arrays = {
        name: 0.3 * rng.standard_normal(shape).astype(np.float32) for name, shape in shapes_of(WIDTHS).items()
    }
    return ReaderWeights(
        arrays=arrays, widths=WIDTHS, scale=0.9, offset=0.1, prior_log_odds=-3.0, trained="at random"
    )


def plain_convolution(arrays, name, maps):
    """Written out channel by channel, in double precision."""
    kernels, biases = arrays[f"{name}.weight"].astype(float), arrays[f"{name}.bias"].astype(float)
    sums = [
        bias + sum(correlate(m, k, mode="constant") for m, k in zip(maps, own, strict=True))
        for own, bias in zip(kernels, biases, strict=True)
    ]
    return np.maximum(np.stack(sums), 0.0)


def plain_network(arrays, frame):
    levels, maps = [], frame.astype(float)
    for level in range(len(WIDTHS)):
        if level:
            maps = np.maximum.reduce([maps[:, i::2, j::2] for i in (0, 1) for j in (0, 1)])
        for n in range(2):
            maps = plain_convolution(arrays, f"down{level}.{n}", maps)
        levels.append(maps)
    for level in reversed(range(len(WIDTHS) - 1)):
        mixed = np.tensordot(arrays[f"mix{level}.weight"].astype(float), maps, 1)
        mixed += arrays[f"mix{level}.bias"].astype(float)[:, None, None]
        maps = plain_convolution(
            arrays, f"up{level}", levels[level] + mixed.repeat(2, axis=1).repeat(2, axis=2)
        )
    return np.tensordot(arrays["head.weight"].astype(float), maps, 1) + float(arrays["head.bias"][0])


def test_the_network_is_the_plain_sum_over_its_layers(weights):
    frames = np.random.default_rng(1).standard_normal((2, N_CHANNELS, 16, 24)).astype(np.float32)
    before = frames.copy()
    answers = logits_of(weights, frames)
    for frame, answer in zip(frames, answers, strict=True):
        expected = plain_network(weights.arrays, frame)
        # Single precision keeps seven digits of sums of some hundred numbers.
        np.testing.assert_allclose(answer, expected, atol=2e-5 * np.abs(expected).max())
    assert np.array_equal(frames, before)
    assert np.array_equal(logits_of(weights, frames), answers)


def test_weights_come_back_from_their_file(weights, tmp_path):
    file = tmp_path / "weights.safetensors"
    save_weights(weights, file)
    again = load_weights(file)
    assert all(np.array_equal(array, again.arrays[name]) for name, array in weights.arrays.items())
    for name in ("widths", "scale", "offset", "prior_log_odds", "trained"):
        assert getattr(again, name) == getattr(weights, name)


def test_the_file_is_laid_out_as_safetensors_are(weights, tmp_path):
    file = tmp_path / "weights.safetensors"
    save_weights(weights, file)
    content = file.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    assert (8 + length) % 8 == 0
    told = header.pop("__metadata__")
    assert all(isinstance(value, str) for value in told.values())
    ends = sorted(each["data_offsets"] for each in header.values())
    # One array after the other, from the first byte to the last, with no gap between them.
    assert ends[0][0] == 0
    assert [end for _, end in ends[:-1]] == [begin for begin, _ in ends[1:]]
    assert ends[-1][1] == len(content) - 8 - length
    begin, end = header["mix1.weight"]["data_offsets"]
    numbers = np.frombuffer(content[8 + length :][begin:end], "<f4")
    assert np.array_equal(numbers, weights.arrays["mix1.weight"].ravel())


def test_the_shipped_weights_are_small_and_say_how_they_were_trained():
    assert SHIPPED.stat().st_size < 3e6
    shipped = load_weights()
    assert "generated livers from seed 100000" in shipped.trained
    assert shipped.scale > 0.0
    assert shipped.prior_log_odds < 0.0


def changed(content: bytes, old: bytes, new: bytes) -> bytes:
    assert content.count(old) == 1
    return content.replace(old, new)


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda content: b"", "no file of a reader's weights"),
        (lambda content: b"\x89PNG\r\n\x1a\n" + bytes(1000), "no file of a reader's weights"),
        (lambda content: content[: len(content) // 20], "no file of a reader's weights"),
        (lambda content: content[:-4], "damaged: its checksum"),
        (lambda content: content[:-4] + b"\0\0\0\1", "damaged: its checksum"),
        (lambda content: changed(content, b'"scale": "0.9"', b'"scale": "0.8"'), "damaged: its checksum"),
        (
            lambda content: changed(content, b'"version": "1"', b'"version": "9"'),
            "of version 9, and this Sounding reads version 1",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_what_to_do(weights, tmp_path, spoil, text):
    file = tmp_path / "weights.safetensors"
    save_weights(weights, file)
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(FieldError) as told:
        load_weights(file)
    assert text in str(told.value)
    assert str(told.value).startswith(f"reader_weights={file}: ")
    assert "Train it anew" in str(told.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FieldError, match=r"none\.safetensors: this file cannot be read \(No such file"):
        load_weights(tmp_path / "none.safetensors")


def test_layers_that_are_no_numbers_are_refused(weights, tmp_path):
    arrays = dict(weights.arrays)
    arrays["head.bias"] = np.array([np.nan], np.float32)
    file = tmp_path / "weights.safetensors"
    save_weights(dataclasses.replace(weights, arrays=arrays), file)
    with pytest.raises(FieldError, match="damaged: its layers are not those of a reader"):
        load_weights(file)
