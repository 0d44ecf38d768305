"""Options of a plug: each value is read as TOML, a bare word as text, and a slip is not taken for a text."""

from __future__ import annotations

import math
from datetime import date

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.plugs import PlugError, parse_plug_options


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("rate=0.2", 0.2),
        ("rate=1e-3", 1e-3),
        ("rate=inf", math.inf),
        ("n=-3", -3),
        ("n=1_000", 1000),
        ("is_told=true", True),
        ("sizes=[1, 2]", [1, 2]),
        ("table={a = 1, b = [true]}", {"a": 1, "b": [True]}),
        ('text="two words"', "two words"),
        ("text='two words'", "two words"),
        ('text=""', ""),
        ("day=2024-05-01", date(2024, 5, 1)),
        ("name=paper", "paper"),
        ("path=data/organ-1.stl", "data/organ-1.stl"),
        ("formula=a=b", "a=b"),
        ("colour=red#2", "red#2"),
        ("share=1#2", "1#2"),
        ("pair=1, 2", "1, 2"),
        ("pair=1, other = 2", "1, other = 2"),
        ("text=two words", "two words"),
        (" rate = 0.2 ", 0.2),
    ],
)
def test_values_are_toml_or_bare_words(word: str, value: object) -> None:
    (parsed,) = parse_plug_options([word]).values()
    assert parsed == value
    assert type(parsed) is type(value)


def test_options_keep_their_names_and_order() -> None:
    assert list(parse_plug_options(["b=1", "a=x"]).items()) == [("b", 1), ("a", "x")]
    assert parse_plug_options([]) == {}


@given(st.floats(allow_nan=False) | st.integers(-(2**63), 2**63 - 1))
def test_numbers_as_python_writes_them_are_read_back(number: float) -> None:
    assert parse_plug_options([f"n={number!r}"]) == {"n": number}


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("rate", "'rate' is no option; write name=value, for example rate=0.2."),
        ("n-rays=3", "'n-rays=3': 'n-rays' cannot be an option's name"),
        ("=3", "'' cannot be an option's name"),
        ("rate=", 'write "" for an empty text'),
        ("rate=.5", 'write the number as 0.5, or ".5" with quotes for a text'),
        ("rate=5.", "write the number as 5.0"),
        ("n=007", "write the number as 7, or"),
        ("is_told=True", 'write true, or "True" with quotes for a text'),
        ("radius=None", 'leave the option out to keep its default, or write "None"'),
        ("sizes=[1, two]", "close its quotes and brackets"),
        ("text='it's'", "close its quotes and brackets"),
        ('text="open', "close its quotes and brackets"),
    ],
)
def test_slips_are_named_with_the_remedy(word: str, message: str) -> None:
    with pytest.raises(PlugError) as caught:
        parse_plug_options([word])
    assert message in str(caught.value)
    assert f"'{word}'" in str(caught.value)


def test_a_name_given_twice_is_refused() -> None:
    with pytest.raises(PlugError, match="'rate=2': the option rate is given twice; leave one of the two out"):
        parse_plug_options(["rate=1", "rate=2"])


def test_a_further_line_cannot_smuggle_in_another_option() -> None:
    assert parse_plug_options(["a=1\nb=2"]) == {"a": "1\nb=2"}
    assert parse_plug_options(["a=1}\nb={c=2"]) == {"a": "1}\nb={c=2"}
