"""Text made safe to show."""

from hypothesis import given
from hypothesis import strategies as st

from grs_agents.views.common.safe_text import (
    LONGEST,
    replace_undrawable_chars,
    to_markdown_cell,
    to_markdown_code_block,
    to_terminal_line,
    to_viewer_markdown,
)


@given(st.text())
def test_drawable_text_stays_as_it_is(text: str) -> None:
    once = replace_undrawable_chars(text)
    assert replace_undrawable_chars(once) == once


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126)))
def test_ascii_is_drawable(text: str) -> None:
    assert replace_undrawable_chars(text) == text


@given(st.text())
def test_nothing_beyond_the_fonts_is_left(text: str) -> None:
    assert all(ord(character) < 0x2714 for character in replace_undrawable_chars(text))


def test_what_cannot_be_drawn_is_spelt() -> None:
    assert (
        replace_undrawable_chars("ok \N{PARTY POPPER} \N{CJK UNIFIED IDEOGRAPH-4E2D}\r\n") == "ok <U+1F389> <U+4E2D>\n"
    )
    assert replace_undrawable_chars("\N{FULLWIDTH LATIN CAPITAL LETTER A}é → ≤") == "Aé → ≤"


def test_documents_are_bounded_and_fetch_nothing() -> None:
    assert "![" not in to_viewer_markdown("![x](http://example.org/x.png)")
    long = to_viewer_markdown("a" * (LONGEST + 7))
    assert len(long) < LONGEST + 60
    assert "7 more characters" in long


@given(st.text(st.sampled_from("`\nab")))
def test_no_text_closes_its_fence(text: str) -> None:
    lines = to_markdown_code_block(text, "python").split("\n")
    assert lines[0].removesuffix("python") == lines[-1]
    assert not any(line.strip().startswith(lines[-1]) for line in lines[1:-1])


@given(st.text())
def test_a_line_for_a_terminal_holds_no_control(text: str) -> None:
    line = to_terminal_line(text, 40)
    assert len(line) <= 40
    assert not any(ord(character) < 32 or 127 <= ord(character) < 160 for character in line)


def test_cells_and_escape_codes() -> None:
    assert to_markdown_cell("a|b\nc") == "a\\|b c"
    assert to_terminal_line("\x1b[31mred\x1b[0m\x07 text") == "red\\x07 text"
