"""Grammar of plain imperatives about objects on a table. A word outside the grammar makes all of the words unread."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal, cast

from grs_agents.models.offline.prompt_text import COLORS, split_words

Kind = Literal["move", "stack", "line", "sort", "clear", "swap", "leave", "pick", "push"]
How = Literal["in", "on", "beside", "leftof", "rightof", "infront", "behind", "outof"]
_VERBS: Final[dict[str, Kind]] = {
    **dict.fromkeys(
        split_words("put place move set bring carry transfer relocate shift pack stow load insert drop store"), "move"
    ),
    **dict.fromkeys(("stack", "pile"), "stack"),
    **dict.fromkeys(("lineup", "line", "align"), "line"),
    **dict.fromkeys(("sort", "group"), "sort"),
    **dict.fromkeys(("clear", "empty"), "clear"),
    **dict.fromkeys(("swap", "exchange", "switch"), "swap"),
    **dict.fromkeys(("leave", "keep"), "leave"),
    **dict.fromkeys(("pickup", "grab", "take", "lift"), "pick"),
    **dict.fromkeys(("push", "sweep"), "push"),
}
ANYWHERE: Final = {"move", "shift", "relocate", "transfer"}
"""Verbs that leave the new place open."""
_IMPOSSIBLE: Final = "fold|unfold|pour|sing|dance|cook|eat|drink|stir|open|close|unscrew|peel"
"""Imperatives that no robot with a suction cup meets; ``open`` and ``close`` elsewhere are parts of names."""
_FORBIDDEN: Final = re.compile(
    rf"(?:^|[.;:!,]|\band|\bthen) *(?:(?:and|then|please) )*({_IMPOSSIBLE})\b"
    r"(?= (?:the|a|an|it|them|all|both)\b| *[.;,!]| *$)"
)
_PREPOSITIONS: Final[set[str]] = {"in", "on", "beside", "leftof", "rightof", "infront", "behind", "outof"}
_NUMBERS: Final = {
    word: number for number, word in enumerate(split_words("one two three four five six seven eight nine ten"), 1)
}
GENERIC: Final = {"object", "thing", "item"}
_PRONOUNS: Final = {"it", "them", "everything", "both"}
_FIRST, _THEN, _LAST = {"first", "firstly"}, {"then", "next", "afterwards"}, {"finally", "lastly"}
FLAGS: Final = {
    "bottomup", "topdown", "shortfirst", "tallfirst", "leftright", "rightleft", "bycolor", "bykind", "own", "inorder",
    "sidebyside", "inrow", "freeplace",
}  # fmt: skip
"""Words about a request as a whole, each for a phrase."""
_IDLE: Final = {"please", "carefully", "now", "place", "places", "their", "down", "up", "so", "that"}
"""Words without a meaning of their own after a complete request."""
_RESERVED: Final = {
    *_VERBS, *_PREPOSITIONS, *_NUMBERS, *GENERIC, *_PRONOUNS, *_FIRST, *_THEN, *_LAST, *FLAGS, *_IDLE, *COLORS, "table",
    *split_words("the a an all both each every and but of with without for to from at by as is no not other another"),
}  # fmt: skip
"""Words of the grammar, which are no adjectives."""
_PHRASES: Final = (
    (r"\bon top of\b|\bonto\b|\bon to\b|\bupon\b|\batop\b", "on"),
    (r"\binto\b|\binside(?: of)?\b", "in"),
    (r"\b(?:to|on) the (left|right)(?: hand)?(?: side)? of\b|\b(left|right) of\b", r"\1\2of"),
    (r"\bin front of\b", "infront"),
    (r"\bout of\b", "outof"),
    (r"\bnext to (?:each other|one another)\b|\bside by side\b", "sidebyside"),
    (r"\bnext to\b|\bclose to\b|\balongside\b", "beside"),
    (r"\bin (?:this|that) order\b", "inorder"),
    (r"\bfrom (?:the )?left to (?:the )?right\b", "leftright"),
    (r"\bfrom (?:the )?right to (?:the )?left\b", "rightleft"),
    (r"\bfrom (?:the )?bottom (?:to (?:the )?top|up)\b", "bottomup"),
    (r"\bfrom (?:the )?top (?:to (?:the )?bottom|down)\b", "topdown"),
    (r"\bfrom (?:the )?shortest to (?:the )?tallest\b", "shortfirst"),
    (r"\bfrom (?:the )?tallest to (?:the )?shortest\b", "tallfirst"),
    (r"\bin a (?:row|line)\b", "inrow"),
    (r"\bby (?:their )?colou?r\b", "bycolor"),
    (r"\bby (?:their )?(?:kind|type|category)\b", "bykind"),
    (r"\bof (?:its|their) own\b", "own"),
    (r"\b(?:on |to )?a free (?:part|spot|place) (?:of|on) the table\b", "on table freeplace"),
    (r",? ?\b(?:as )?seen (?:by|from) the robot\b,?|,? ?\bas the robot sees (?:it|them)\b", " "),
    (r"\bthe table(?:top)?\b", "table"),
    (r"\bline up\b", "lineup"),
    (r"\bpick up\b", "pickup"),
    (r"\blet (.+?) (?:exchange|swap|change) (?:their )?places\b", r"swap \1"),
    (r"\b(?:exchange|swap) the places of\b", "swap"),
    (r"\bleave ([^.;:!?,]*?) (?:where (?:it|they) (?:is|are|stands?)|alone)\b", r"leave \1"),
    (r"\bgrey\b", "gray"),
)
"""Phrases that the grammar takes as single words."""


class NotUnderstood(Exception):
    """The words are not in the grammar, or they are ambiguous."""


@dataclass(frozen=True)
class NounPhrase:
    """A noun phrase: nouns and colours of an object or of several."""

    nouns: tuple[str, ...] = ()  # as written
    colors: tuple[str, ...] = ()
    adjectives: tuple[str, ...] = ()
    number: int | None = None
    article: Literal["", "the", "a", "all"] = ""
    pronoun: str = ""

    @property
    def text(self) -> str:
        """The words, for a reason."""
        return " ".join(filter(None, ("the", *self.adjectives, *self.colors, *self.nouns, self.pronoun)))

    @property
    def is_table(self) -> bool:
        """True for the bare table."""
        return self.nouns == ("table",)

    @property
    def is_generic(self) -> bool:
        """True if it names no kind: "the objects"."""
        return bool(self.nouns) and all(make_singular(noun) in GENERIC for noun in self.nouns)


@dataclass
class Request:
    """A request: a verb, objects, places and flags."""

    kind: Kind
    verb: str
    objects: list[NounPhrase] = field(default_factory=list[NounPhrase])
    places: list[tuple[How, NounPhrase]] = field(default_factory=list[tuple[How, NounPhrase]])
    flags: set[str] = field(default_factory=set[str])
    heading: bool = False  # requests after a colon give its details
    elided: bool = False  # its verb is that of the request before it
    after: bool = False  # after all previous requests in time
    first: bool = False  # before all others
    last: bool = False  # after all others


def make_singular(word: str) -> str:
    """``boxes`` and ``berries`` as ``box`` and ``berry``."""
    if word.endswith("ies") and len(word) > 4 and word != "cookies":
        return f"{word[:-3]}y"
    if word.endswith(("ches", "shes", "xes", "sses")):
        return word[:-2]
    return word[:-1] if word.endswith("s") and not word.endswith(("ss", "us")) else word


def find_impossible_verb(words: str) -> str:
    """An imperative that this robot cannot meet; empty if there is none."""
    found = _FORBIDDEN.search(words.lower())
    return found[1] if found else ""


def parse_requests(words: str, nouns: set[str], adjectives: set[str]) -> list[Request]:
    """Parse words into requests, in their order.

    Args:
        words: the text.
        nouns: known nouns of objects, in the singular and as they are written.
        adjectives: words that may precede a noun.

    Raises:
        NotUnderstood: a word is outside the grammar, or there is no request.
    """
    text = re.sub(r"[-/]", " ", words.lower().strip())
    for pattern, word in _PHRASES:
        text = re.sub(pattern, lambda match, word=word: f" {match.expand(word).strip()} ", text)
    if odd := re.findall(r"[^\sa-z0-9.,;:!]", text):
        raise NotUnderstood(f"not understood: {' '.join(dict.fromkeys(odd))}")
    requests: list[Request] = []
    for sentence, mark in re.findall(r"([^.;:!]+)([.;:!]|$)", text):
        tokens = re.findall(r"[a-z]+|\d+|,", sentence)
        if not tokens:
            continue
        before = len(requests)
        _Parser(tokens, nouns, adjectives - _RESERVED, requests).parse()
        if mark == ":":
            for request in requests[before:]:
                request.heading = True
    if not requests:
        raise NotUnderstood("no request is understood")
    return _resolve_pronouns(requests)


class _Parser:
    """Recursive descent over the tokens of a sentence."""

    def __init__(self, tokens: Sequence[str], nouns: set[str], adjectives: set[str], requests: list[Request]) -> None:
        self.tokens, self.nouns, self.adjectives, self.requests = tokens, nouns, adjectives, requests
        self.at = 0

    def parse(self) -> None:
        """Append all requests of the sentence."""
        while self.at < len(self.tokens):
            self._parse_request()

    def _peek(self, ahead: int = 0) -> str:
        index = self.at + ahead
        return self.tokens[index] if index < len(self.tokens) else ""

    def _skip(self, words: set[str]) -> set[str]:
        found: set[str] = set()
        while self._peek() in words:
            found.add(self._peek())
            self.at += 1
        return found

    def _parse_request(self) -> None:
        when = self._skip({",", "and", "please", "but", "now", *_FIRST, *_THEN, *_LAST})
        if not self._peek():
            if when - {",", "and"}:
                raise NotUnderstood(f"not understood: {' '.join(sorted(when))}")
            return
        verb = self._peek()
        if verb in _VERBS:
            self.at += 1
            request = Request(_VERBS[verb], verb)
        elif self.requests and self.requests[-1].places:  # an elided verb: "A in the box and B in the bowl"
            request = Request(self.requests[-1].kind, self.requests[-1].verb, elided=True)
        else:
            raise NotUnderstood(f"not understood: {verb}")
        request.first, request.last, request.after = bool(when & _FIRST), bool(when & _LAST), bool(when & _THEN)
        self.requests.append(request)
        while (phrase := self._parse_noun_phrase()) is not None:
            request.objects.append(phrase)
            if not self._continue_list():
                break
        _share_nouns(request.objects)
        while self.at < len(self.tokens):
            token = self._peek()
            if token in _PREPOSITIONS:
                self.at += 1
                if (place := self._parse_noun_phrase()) is None:
                    raise NotUnderstood(f"not understood: {token} {self._peek()}")
                request.places.append((cast(How, token), place))
            elif token in FLAGS:
                request.flags.add(token)
                self.at += 1
            elif token in _IDLE and request.objects:
                self.at += 1
            elif token == "first" and self._peek(1) in ("", ","):
                request.first = True
                self.at += 1
            elif token == "," and self._peek(1) in FLAGS:
                self.at += 1
            elif token in {",", "and", "but", *_THEN, *_LAST}:
                return
            else:
                raise NotUnderstood(f"not understood: {token}")

    def _continue_list(self) -> bool:
        """Pass a comma or ``and`` before another noun phrase."""
        begin = self.at
        self._skip({",", "and"})
        following = self._peek()
        if self.at > begin and following and following not in {*_VERBS, *_THEN, *_LAST, *_FIRST, *FLAGS, "but"}:
            return True
        self.at = begin
        return False

    def _parse_noun_phrase(self) -> NounPhrase | None:
        phrase, begin = NounPhrase(), self.at
        while token := self._peek():
            extended = self._extend(phrase, token)
            if extended is None:
                break
            phrase = extended
            self.at += 1
        if self.at > begin and not (phrase.nouns or phrase.pronoun or phrase.colors):
            raise NotUnderstood(f"not understood: {self._peek() or self.tokens[self.at - 1]}")
        return phrase if self.at > begin else None

    def _extend(self, phrase: NounPhrase, token: str) -> NounPhrase | None:
        """The phrase with its next word; None if the word belongs to none."""
        named = bool(phrase.nouns or phrase.pronoun)
        following = make_singular(self._peek(1))
        if token in ("the", "a", "an", "all", "both", "each", "every") and not named and not phrase.colors:
            if token == "both" and following not in self.nouns | {"the", "of", *COLORS}:
                return replace(phrase, pronoun="both")
            if token in ("all", "both", "each", "every"):
                return replace(phrase, article="all", number=2 if token == "both" else phrase.number)
            return phrase if phrase.article == "all" else replace(phrase, article="the" if token == "the" else "a")
        if token == "of" and (
            (named and (following in self.nouns or self._peek(1) in self.nouns))
            or (not named and phrase.article == "all")
        ):
            return phrase
        if named and token in self.nouns | {make_singular(noun) for noun in phrase.nouns} and not phrase.pronoun:
            return replace(phrase, nouns=(*phrase.nouns, token))
        if token.isdigit() or token in _NUMBERS:
            return None if named else replace(phrase, number=int(token) if token.isdigit() else _NUMBERS[token])
        # a colour may be a part of a name: orange juice
        part_of_name = token in self.nouns and following in self.nouns and f"{token} {following}" in self.nouns
        if token in COLORS and not part_of_name:
            return None if named else replace(phrase, colors=(*phrase.colors, token))
        if token in self.adjectives and not named and self._peek(1).isalpha():
            return replace(phrase, adjectives=(*phrase.adjectives, token))
        if token in _PRONOUNS:
            return None if named else replace(phrase, pronoun=token)
        if token in self.nouns or make_singular(token) in self.nouns | GENERIC or token == "table":
            return None if phrase.pronoun else replace(phrase, nouns=(*phrase.nouns, token))
        return None


def _share_nouns(phrases: list[NounPhrase]) -> None:
    """Give the last noun to colours before it: "the red and the blue block", "the red and blue blocks"."""
    donor: NounPhrase | None = None
    for index in range(len(phrases) - 1, -1, -1):
        if phrases[index].nouns:
            donor = phrases[index]
        elif phrases[index].colors and donor is not None:
            nouns = (*donor.nouns[:-1], make_singular(donor.nouns[-1]))
            phrases[index] = replace(phrases[index], nouns=nouns, article=phrases[index].article or "the")
            if len(phrases) > 1 and donor.number is None:
                place = phrases.index(donor)
                donor = phrases[place] = replace(donor, nouns=nouns)


def _resolve_pronouns(requests: Sequence[Request]) -> list[Request]:
    """Replace ``it``, ``them`` and ``everything`` by the objects before them; a request to pick up joins the next."""
    resolved: list[Request] = []
    spoken: list[NounPhrase] = []
    for asked in requests:
        backward = any(phrase.pronoun for phrase in asked.objects)
        if (backward or not asked.objects) and not spoken and asked.kind not in ("clear", "sort"):
            raise NotUnderstood("a pronoun refers to nothing before it")
        request = replace(asked)
        last = resolved[-1] if resolved else None
        picked = last if last is not None and last.kind == "pick" and not last.places else None
        if backward or (picked is not None and not asked.objects):
            request.objects = [*spoken, *(phrase for phrase in asked.objects if not phrase.pronoun)]
            if picked is not None:
                resolved.pop()
                request.first, request.last = picked.first or asked.first, picked.last or asked.last
                request.after = picked.after
        candidates = [phrase for _, phrase in resolved[-1].places] if resolved else []
        if not candidates and resolved and resolved[-1].kind == "clear":
            candidates = resolved[-1].objects
        request.places = list(_resolve_places(request, candidates))
        resolved.append(request)
        spoken = request.objects if request.kind not in ("clear", "leave") else spoken
    if any(request.kind == "pick" and not request.places for request in resolved):
        raise NotUnderstood("a thing is picked up, and not said to be put anywhere")
    return [replace(request, kind="move") if request.kind == "pick" else request for request in resolved]


def _resolve_places(request: Request, candidates: Sequence[NounPhrase]) -> Iterator[tuple[How, NounPhrase]]:
    for how, phrase in request.places:
        if not phrase.pronoun:
            yield how, phrase
        elif len(candidates) == 1:
            yield how, candidates[0]
        else:
            raise NotUnderstood(f"unclear: what {phrase.pronoun} is")
