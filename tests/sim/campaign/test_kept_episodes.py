"""Benchmarks keep their episodes as they end, and go on where they were stopped."""

from functools import partial

from benchmarks.kept_episodes import KeptEpisodes

FIRST, SECOND = (("seed", 0),), (("seed", 1),)
"""Jobs, which are their own settings and their own rows."""


def test_episodes_that_the_file_has_are_not_run_again(tmp_path) -> None:
    file = tmp_path / "new" / "kept.jsonl"
    with KeptEpisodes(file, partial(dict, call=1), dict, n_jobs=1) as kept:
        [first] = kept.rows([FIRST])
        one = file.read_bytes()
        both = kept.rows([SECOND, FIRST])
    # The first is there once, and rows come in the order that was asked for.
    assert file.read_bytes().startswith(one)
    assert file.read_bytes().count(b"\n") == 2
    assert [each["seed"] for each in both] == [1, 0]
    assert both[1] == first
    # The second was cut off in the middle of its line, as a kill would.
    file.write_bytes(file.read_bytes()[:-20])
    with KeptEpisodes(file, partial(dict, call=2), dict, n_jobs=1) as kept:
        again = kept.rows([FIRST, SECOND])
    assert [each["call"] for each in again] == [1, 2]
    assert file.read_bytes().startswith(one)
