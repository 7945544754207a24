"""The thoughts of a reasoning model, which servers without a reasoning parser leave in its reply."""

import re

_NAMES = "think|thinking|thoughts?|reasoning|antthinking|seed:think|mm:think"
_MARK = re.compile(
    r"^[ \t]*(?P<fence>`{3,}|~{3,})(?=(?P<info>[^\n]*))"
    rf"|(?P<open><(?:{_NAMES})[ ]?>|(?-i:\[THINK\])|◁think▷|<\|START_THINKING\|>|<\|begin_of_thought\|>"
    r"|<\|inner_prefix\|>|<\|channel>thought\b|<\|channel\|>(?:analysis|commentary)\b)"
    rf"|(?P<close></(?:{_NAMES})[ ]?>|(?-i:\[/THINK\])|◁/think▷|<\|END_THINKING\|>|<\|end_of_thought\|>"
    r"|<\|inner_suffix\|>|<channel\|>|<\|channel\|>final\b(?:[^<\n]|<\|constrain\|>)*<\|message\|>)",
    re.MULTILINE | re.IGNORECASE,
)
"""Fences of code, and the marks around thoughts: of DeepSeek, Qwen and most others; Seed-OSS, MiniMax, Magistral, Kimi,
Cohere, OpenThinker, Apertus, Gemma and gpt-oss."""
_UNMARKED = re.compile(
    r"\s*(?:(?:assistant)?(?:analysis|commentary).*?)?assistantfinal"
    r"|\s*Here(?:'s| is) my thought process:.*?Here(?:'s| is) my response:",
    re.DOTALL,
)
"""How gpt-oss begins where its special tokens are dropped, and Granite."""
_LEADING_TOKENS = re.compile(r"\s*(?:<\|\w{1,40}\|>(?:assistant\b)?\s*)+")
_TRAILING_TOKENS = re.compile(r"(?:\s*(?:<[|｜][\w▁]{1,40}[|｜]>|</s>|<eos>|<end_of_turn>))+\s*\Z")
_TAIL = 200
"""Characters at the end of a reply that special tokens are looked for in."""
_QUOTES = ("'", '"', "`")
_BLANK_REST = re.compile(r"[ \t]*(?:\n|\Z)")


def cut_thoughts(text: str) -> str:
    """``text`` without the thoughts in it, and without special tokens around it; lines end in ``\\n``.

    A mark of thoughts counts where it stands by itself: not in quotes, and not in a block of code. All before an end
    without a beginning is thoughts, as is all after a beginning without an end.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if unmarked := _UNMARKED.match(text):
        text = text[unmarked.end() :]
    kept = _cut_marked_thoughts(text)
    if leading := _LEADING_TOKENS.match(kept):
        kept = kept[leading.end() :]
    return kept[:-_TAIL] + _TRAILING_TOKENS.sub("", kept[-_TAIL:])


def _cut_marked_thoughts(text: str) -> str:
    kept: list[str] = []
    start = depth = last_close = 0  # of the answer; of nested thoughts; where the last end of them lies
    fence = ""  # what opened the block of code that the answer is in
    fences_left = sum(1 for mark in _MARK.finditer(text) if mark["fence"])
    end, blank, odd_quotes = 0, True, False  # of the last mark; what is before the next one on its line
    for mark in _MARK.finditer(text):
        between = text[end : mark.start()]
        _, new_line, before = between.rpartition("\n")
        quotes = before.count('"') - before.count('\\"')
        blank = (blank or bool(new_line)) and not before.strip()
        odd_quotes = (odd_quotes and not new_line) != bool(quotes % 2)
        end = mark.end()
        if mark["fence"]:
            blank, fences_left, fence = False, fences_left - 1, _follow_fence(fence, mark["fence"], mark["info"])
            continue
        quoted = text[end : end + 1] in _QUOTES and text[mark.start() - 1 : mark.start()] == text[end : end + 1]
        if quoted or (odd_quotes and not blank and not depth):
            continue
        special = mark[0].startswith(("<|", "<channel"))
        if mark["open"]:
            if depth:
                depth += blank and not special
            elif not fence and (blank or special):
                kept.append(text[start : mark.start()])
                depth, last_close = 1, 0
        elif depth:
            depth, last_close = 0 if special else depth - 1, end
            if not depth:
                start, fence = end, ""
        # In code: thoughts that stopped within a draft, unless the code goes on, so that a fence is left over
        elif not fence or (blank and _BLANK_REST.match(text, end) and fences_left % 2 == 0):
            kept.clear()
            start, fence = end, ""
    if not depth:
        kept.append(text[start:])
    elif last_close:  # a beginning that was written twice
        kept.append(_cut_marked_thoughts(text[last_close:]))
    return "".join(kept)


def _follow_fence(opened: str, run: str, info: str) -> str:
    """What opened the block of code after a fence; empty outside of all blocks."""
    if opened:
        return "" if run.startswith(opened) and not info.strip() else opened
    return "" if "`" in run and "`" in info else run
