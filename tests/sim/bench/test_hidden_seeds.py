"""Hidden seeds follow from the key, and nothing that is shown tells them."""

from __future__ import annotations

import hashlib
import json

import pytest

from sim.bench.hidden_seeds import commitment, hidden_seed, read_key
from sim.bench.run import BenchSettings, run_bench
from sim.bench.verify import verify
from sim.errors import FieldError

KEY = bytes(range(32))


def by_hand(key: bytes, text: bytes) -> int:
    """HMAC-SHA256 as RFC 2104 writes it, for keys of at most 64 bytes."""
    block = key.ljust(64, b"\0")
    inner = hashlib.sha256(bytes(b ^ 0x36 for b in block) + text).digest()
    return int.from_bytes(hashlib.sha256(bytes(b ^ 0x5C for b in block) + inner).digest()[:8], "big") // 2


def test_seeds_are_the_hmac_of_task_and_number() -> None:
    assert hidden_seed(KEY, "sphere-v1", 3) == by_hand(KEY, b"sphere-v1|3")


def test_seeds_differ_by_key_task_and_number() -> None:
    others = [(KEY[::-1], "a-v1", 0), (KEY, "b-v1", 0), (KEY, "a-v1", 1), (KEY, "a-v1", 0)]
    assert len({hidden_seed(*each) for each in others}) == 4
    assert all(0 <= hidden_seed(*each) < 2**63 for each in others)


def test_a_short_key_is_refused(tmp_path) -> None:
    (tmp_path / "key").write_bytes(b"guess me")
    with pytest.raises(FieldError, match="8 bytes; a key that nobody guesses has 32"):
        read_key(tmp_path / "key")
    with pytest.raises(FieldError, match="cannot be read"):
        read_key(tmp_path / "none")


@pytest.mark.usefixtures("here")
def test_a_submission_of_hidden_seeds_shows_none_and_is_checked_with_the_key(toys, tmp_path) -> None:
    run_bench("random", toys[:1], tmp_path / "out", BenchSettings(quick=True, key=KEY))
    text = (tmp_path / "out" / "submission" / "submission.json").read_text()
    content = json.loads(text)
    assert content["key"] == commitment(KEY)
    for index in range(2):
        assert str(hidden_seed(KEY, "toy-v1", index)) not in text
    assert verify(tmp_path / "out", key=KEY, tasks=toys).faults == ()
    with pytest.raises(FieldError, match="has hidden seeds"):
        verify(tmp_path / "out", tasks=toys)
    with pytest.raises(FieldError, match="another key"):
        verify(tmp_path / "out", key=KEY[::-1], tasks=toys)
