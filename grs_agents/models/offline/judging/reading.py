"""Parser of plain English about objects on a table into requests: objects, destinations, order; and unknown words.

Only checkable words are parsed. A word that is neither an object's nor in the lists below is reported, never skipped.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from grs_agents.models.offline.prompt_text import COLORS, split_words


def split_into_word_set(text: str) -> frozenset[str]:
    """Set of the words of a text."""
    return frozenset(split_words(text))


MOVING = split_into_word_set(
    "put place move set lay stand bring carry take transfer drop position park pack stow load store insert deposit "
    "distribute gather collect arrange organize relocate shift return deliver serve tidy let remove"
)
PUSHING = {"push", "sweep", "slide", "shove", "brush"}
STACKING = {"stack", "pile", "build", "make", "form"}
SORTING = {"sort", "group", "separate", "categorize", "match", "divide"}
LINING = {"lineup", "line", "align"}
CLEARING = {"clear", "empty", "unpack", "free"}
SWAPPING = {"swap", "exchange", "switch", "trade"}
LEAVING = {"leave", "keep"}
PICKING = {"pickup", "grab", "grasp", "lift"}
KNOWN = MOVING | PUSHING | STACKING | SORTING | LINING | CLEARING | SWAPPING | LEAVING | PICKING
IMPOSSIBLE = split_into_word_set(
    "fold unfold pour sing open close cut slice chop wash clean wipe cook heat eat drink dance flip stir mix screw "
    "unscrew press peel shake crush throw toss break tear roll spin tie write draw paint fill squeeze hang juggle wrap "
    "burn read play buy spill pull knock tap hit smash bake fry plug"
)
_NUMBERS = split_words("zero one two three four five six seven eight nine ten eleven twelve")
_SIZES = {
    **dict.fromkeys(("tall", "high"), (2, 1)),
    **dict.fromkeys(("short", "low", "flat"), (2, -1)),
    **dict.fromkeys(("large", "big"), (3, 1)),
    **dict.fromkeys(("small", "little"), (3, -1)),
    **dict.fromkeys(("wide", "thick"), (0, 1)),
    **dict.fromkeys(("narrow", "thin"), (0, -1)),
    "long": (1, 1),
}
"""Words of size: measure (0 least width, 1 greatest width, 2 height, 3 volume), and 1 for great or -1 for little."""
_SIDES = {"left": (4, 1, True), "leftmost": (4, 1, True), "right": (4, -1, True), "rightmost": (4, -1, True)}
"""Words that select an object by its place at the start."""
_SUPERLATIVES = {
    superlative: (measure, sign, True)
    for word, (measure, sign) in reversed(_SIZES.items())
    for superlative in (f"{word}est", f"{word}st", f"{word}{word[-1]}est")
}
_SELECTING = {**_SUPERLATIVES, **{word: (measure, sign, False) for word, (measure, sign) in _SIZES.items()}, **_SIDES}
PREPOSITIONS = {"in", "on", "beside", "leftof", "rightof", "infront", "behind", "between", "around", "outof", "at"}
GENERIC = {"object", "item", "thing", "piece", "grocery", "stuff", "good", "product", "one"}
PRONOUNS = {"it", "them", "they", "everything", "both", "all", "each", "these", "those", "anything"}
OTHERS = {"rest", "other", "others", "remaining", "else"}
_PLAIN = {"open", "empty", "free", "loose", "cardboard", "plastic", "wooden", "single", "movable", "toy"}
"""Adjectives that do not select."""
ORDERS = split_into_word_set(
    "bottomup topdown shortfirst tallfirst smallfirst largefirst leftright rightleft bycolor bykind own owncolor "
    "inorder sizedfirst sidebyside inrow together freeplace"
)
_IDLE = split_into_word_set(
    "please robot arm carefully neatly gently up down so there now should must be "
    "is are ends end go goes belong belongs also onto that position and with "
    "place places just directly using suction cup gripper of"
)
AFTER, FIRST, LAST = {"then", "subsequently", "next", "afterwards"}, {"first", "firstly"}, {"finally", "lastly"}
"""Words for the order in time among requests."""
_JOINTS = {",", "and", "but"}
_SPANS = (
    ("left", "right", "leftright", "rightleft"),
    ("bottom", "top", "bottomup", "topdown"),
    ("shortest|lowest", "tallest|highest", "shortfirst", "tallfirst"),
    ("smallest", "largest|biggest", "smallfirst", "largefirst"),
)
"""The two ends of an order, and its names from either end."""
_SINGLE = (
    (r"\bon top of\b|\bonto\b|\bon to\b|\bupon\b|\batop\b|\bover\b", " on "),
    (r"\bin between\b", " between "),
    (
        r"\b(?:to|on|at) the (?:robot |immediate )?(left|right)(?: hand)?(?: side)? of\b|\b(left|right) of\b",
        r" \1\2of ",
    ),
    (r"\bin front of\b", " infront "),
    (r"\bout of\b|\boff\b|\baway from\b|\bfrom inside\b", " outof "),
    *(
        (rf"\bfrom (?:the )?(?:{begin}) to (?:the )?(?:{end})\b", f" {order} ")
        for low, high, *orders in _SPANS
        for begin, end, order in ((low, high, orders[0]), (high, low, orders[1]))
    ),
    (r"\bfrom (?:the )?bottom up\b|\bbottom up\b", " bottomup "),
    (r"\bfrom (?:the )?top down\b|\btop down\b", " topdown "),
    (r"\bin (?:this|that|the given) order\b", " inorder "),
    (r"\bside by side\b|\bnext to (?:each other|one another)\b", " sidebyside "),
    (r"\b(?:in|into|to) (?:a|one) (?:row|line)\b", " inrow "),
    (r",? ?\b(?:as )?seen (?:by|from) the robot\b|,? ?\bfrom the robot (?:(?:point of )?view|perspective)\b", " "),
    (r",? ?\bas the robot sees (?:it|them|this)\b", " "),
    (r"\bnext to\b|\bclose to\b|\bnear(?: to)?\b|\balongside\b|\badjacent to\b|\bby the side of\b", " beside "),
    (r"\bby (?:their |its |the )?colou?rs?\b", " bycolor "),
    (r"\b(?:by|in order of) (?:their |its |the )?heights?\b", " shortfirst "),
    (r"\bby (?:their |its |the )?(?:kind|type|category|sort)s?\b", " bykind "),
    (r"\b(?:of|with) (?:the same|its own|their own|its|their) colou?rs?\b", " owncolor "),
    (r"\bof (?:its|their) own\b", " own "),
    *(
        (rf"\b(?:the )?(?:{words}) first\b", f" {order} sizedfirst ")
        for low, high, *orders in _SPANS[2:]
        for words, order in zip((low, high), orders, strict=True)
    ),
    (
        r"\b(?:change|exchange|swap|switch|trade)s? (?:their )?places?(?: with)?(?: each other| one another)?\b",
        " swap ",
    ),
    (r"\b(?:exchange|swap|switch|trade) the places? of\b", " swap "),
    (r"\bline up\b", " lineup "),
    (r"\bleave ([^.;:!?]*) alone\b", r"leave \1"),
    (r"\b(?:do not|don t|never|without) (?:moving|move|touching|touch)\b(?! each| one)", " , leave "),
    (r"\b(each|all|both|every|any|one) of (?=the\b)", r"\1 "),
    (r"\b(?:build|make|form) (?:a|one) (?:stack|tower|pile) (?:of|from|with)\b", " stack "),
    (r"\band (?:then )?(?:a|one|another)(?: stack| tower| pile)? of\b", " and stack "),
    (r"\bl shaped\b", " "),
    (r"\bpick up\b|\bpick\b", " pickup "),
    (r"\bpile up\b", " stack "),
    (r"\binto\b|\binside(?: of)?\b|\bwithin\b", " in "),
    (r"\b(?:and )?as well as\b|\band also\b|\bplus\b|&", " and "),
    (
        r"\b(?:to |on |in )?(?:a |the )?(?:free|bare|clear) (?:part|spot|area|place|space)(?: (?:of|on) the table)?\b",
        " on table freeplace ",
    ),
    (r",? wherever (?:it|they) (?:is|are|stands?|lies?)\b|\bwhere (?:it|they) (?:is|are|stands?|lies?)\b", " "),
    (r"\bfrom\b", " outof "),
    (r"\b(?:to|towards) (?=the|a|an|its|their|each)\b", " at "),
    (r"\bthe table(?:top)?\b", " table "),
    (r"\bgrey\b", " gray "),
    (r"\bthen(?= (?:the|a|an|all|both|two|three)\b)", " subsequently "),
)
"""Phrases that the parser treats as a single word."""


@dataclass(frozen=True)
class Phrase:
    """A noun phrase: an object or several."""

    nouns: tuple[str, ...] = ()
    colors: tuple[str, ...] = ()
    sizes: tuple[tuple[int, int, bool], ...] = ()  # measure, great (1) or little (-1), superlative
    number: int | None = None
    article: str = ""  # the, a, each, all
    plurals: tuple[str, ...] = ()  # nouns in the plural
    pronoun: str = ""
    unknown: tuple[str, ...] = ()
    vacant: bool = False  # nothing is in or on it

    @property
    def text(self) -> str:
        """The words, for a reason."""
        return " ".join(["the", *self.colors, *(self.nouns or self.unknown or (self.pronoun or "thing",))])

    @property
    def is_bare_table(self) -> bool:
        """True if it means the bare table."""
        return "table" in self.nouns

    @property
    def has_no_specific_noun(self) -> bool:
        """True if it names no kind of object: "the objects"."""
        return {*self.nouns} <= GENERIC

    @property
    def plural(self) -> bool:
        """True if a noun is plural."""
        return bool(self.plurals)

    @property
    def means_all(self) -> bool:
        """True if it means all objects that it fits."""
        return self.plural or self.article in ("all", "each") or self.pronoun in OTHERS | {"everything", "all", "each"}

    @property
    def has_referent(self) -> bool:
        """True if it has a noun, a pronoun or an unknown word."""
        return bool(self.nouns or self.pronoun or self.unknown)


@dataclass
class Request:
    """A request: a verb, objects and destinations."""

    verb: str
    movers: list[Phrase] = field(default_factory=list[Phrase])
    relations: list[tuple[str, list[Phrase]]] = field(default_factory=list[tuple[str, list[Phrase]]])
    orders: set[str] = field(default_factory=set[str])
    heading: bool = False  # the requests after it give the details
    after: bool = False  # after the previous requests in time
    first: bool = False  # before all others
    last: bool = False  # after all others

    @property
    def has_carrier(self) -> bool:
        """True if it puts objects in or on an object, not the table."""
        places = [phrases for how, phrases in self.relations if how in ("in", "on", "at")]
        return any(not phrase.is_bare_table for phrases in places for phrase in phrases)


@dataclass
class ParsedWords:
    """The requests of the words, and the words that are no request."""

    requests: list[Request] = field(default_factory=list[Request])
    impossible: list[str] = field(default_factory=list[str])
    unknown: list[str] = field(default_factory=list[str])


def make_singular(word: str) -> str:
    """``boxes`` and ``berries`` as ``box`` and ``berry``."""
    if word.endswith("ies") and len(word) > 4:
        return f"{word[:-3]}y"
    if word.endswith(("ches", "shes", "xes", "sses")):
        return word[:-2]
    return word[:-1] if word.endswith("s") and not word.endswith(("ss", "us")) else word


def read_request_words(words: str, nouns: set[str]) -> ParsedWords:
    """Parse ``words``; ``nouns``, in the singular, are the known names of objects."""
    text = re.sub(r"[-/]", " ", words.lower().replace("'s", "").replace("\u2019s", ""))
    for pattern, word in _SINGLE:
        text = re.sub(pattern, word, text)
    reading = ParsedWords()
    if odd := re.findall(r"[^\sa-z0-9.,;:!?&'\"]", text):
        reading.unknown.append(" ".join(dict.fromkeys(odd)))
    for sentence, mark in re.findall(r"([^.;:!?]+)([.;:!?]|$)", text):
        tokens = re.findall(r"[a-z]+|\d+|,", sentence)
        for clause in _split_clauses(tokens):
            _ClauseReader(clause, nouns, reading).read(heading=mark == ":")
    for request in reading.requests[:-1]:
        alone = request.verb in SORTING and not request.relations
        request.heading |= alone and all(phrase.has_no_specific_noun for phrase in request.movers)
    return reading


def _split_clauses(tokens: Sequence[str]) -> Iterator[list[str]]:
    """Split a sentence into parts with a verb each."""
    clause: list[str] = []
    for index, token in enumerate(tokens):
        before = tokens[index - 1] if index else ","
        is_verb = token in KNOWN | IMPOSSIBLE and before in _JOINTS | AFTER | LAST | FIRST
        if is_verb and clause:
            # Conjunctions and words of time belong to the next clause.
            end = len(clause)
            while end and clause[end - 1] in _JOINTS | AFTER | LAST:
                end -= 1
            end = end if {*clause[:end]} - FIRST else 0
            if end:
                yield clause[:end]
            clause = clause[end:]
        clause.append(token)
    if clause:
        yield clause


def resolve_pronouns(requests: Sequence[Request]) -> list[Request]:
    """Resolve ``it``, ``them`` and ``everything`` to the last phrases; a request to pick up joins the next request."""
    known: list[Phrase] = []
    spoken_of: list[Phrase] = []  # candidates of "it" as a destination
    resolved: list[Request] = []
    for request in requests:
        named = [phrase for phrase in request.movers if not (phrase.pronoun in PRONOUNS and known)]
        points_back = len(named) < len(request.movers) or (not request.movers and bool(request.relations))
        movers = [*(known if points_back else ()), *named]
        relations = [
            (how, [meant for phrase in places for meant in (spoken_of if phrase.pronoun in PRONOUNS else [phrase])])
            for how, places in request.relations
        ]
        whole = replace(request, movers=movers, relations=relations)
        if points_back and resolved and resolved[-1].verb in PICKING:
            picked = resolved.pop()
            whole = replace(
                whole, after=picked.after, first=picked.first or whole.first, last=picked.last or whole.last
            )
        resolved.append(whole)
        known = known if request.verb in CLEARING else movers
        spoken_of = [*movers, *(phrase for _, places in relations for phrase in places)]
    return resolved


class _ClauseReader:
    """Parser of a clause, from left to right."""

    def __init__(self, tokens: list[str], nouns: set[str], reading: ParsedWords) -> None:
        self.tokens = tokens
        self.nouns, self.reading = nouns, reading
        self.at = 0
        self.when: set[str] = set()  # words of time before the next request

    def read(self, heading: bool) -> None:
        """Add the requests of the clause to the result."""
        passed = {",", "and", "but", *_IDLE, *AFTER, *FIRST, *LAST} - KNOWN - {"place"}
        while self.at < len(self.tokens) and self.tokens[self.at] in passed:
            self.when |= {self.tokens[self.at]} & {*AFTER, *FIRST, *LAST}
            self.at += 1
        if self.at == len(self.tokens):
            return
        verb = self.tokens[self.at]
        if verb in IMPOSSIBLE:
            self.reading.impossible.append(verb)
            return
        if verb in KNOWN:
            self.at += 1
        else:
            verb = "put"  # a description: the can is in the box; or a list that goes on
        request = self._append_request(Request(verb, heading=heading))
        while self.at < len(self.tokens):
            request = self._parse_next_part(request)
        self._set_order_in_time(request)
        for request in self.reading.requests:
            for phrases in (request.movers, *(places for _, places in request.relations)):
                donor = None  # of the last noun: "the red and the blue block", "red and blue blocks"
                for index in range(len(phrases) - 1, -1, -1):
                    if phrases[index].has_referent:
                        donor = index
                    elif donor is not None:
                        phrases[index] = replace(phrases[index], nouns=phrases[donor].nouns)
                        phrases[donor] = replace(phrases[donor], plurals=())

    def _append_request(self, request: Request) -> Request:
        self._set_order_in_time(request)
        self.reading.requests.append(request)
        return request

    def _set_order_in_time(self, request: Request) -> None:
        request.after |= bool(self.when & AFTER)
        request.first |= bool(self.when & FIRST)
        request.last |= bool(self.when & LAST)
        self.when.clear()

    def _consume_verb(self) -> str:
        passed = {",", "and", "but", *_IDLE, *AFTER, *FIRST, *LAST} - KNOWN - {"place"}
        while self.at < len(self.tokens) and self.tokens[self.at] in passed:
            self.when |= {self.tokens[self.at]} & {*AFTER, *FIRST, *LAST}
            self.at += 1
        if self.at == len(self.tokens):
            return ""
        first = self.tokens[self.at]
        if first in IMPOSSIBLE:
            self.reading.impossible.append(first)
            return ""
        if first in KNOWN:
            self.at += 1
            return first
        return "put"  # a description: the can is in the box; or a list that goes on

    def _parse_next_part(self, request: Request) -> Request:
        token = self.tokens[self.at]
        if token in PREPOSITIONS:
            # A second preposition after the same objects is a further relation.
            self.at += 1
            places: list[Phrase] = []
            while (place := self._read_phrase()) is not None:
                places.append(place)
                joined = self.tokens[self.at : self.at + 1] == ["and"] and token == "between" and len(places) < 2
                if not joined:
                    break
                self.at += 1
            if not places:
                self.reading.unknown.append(token)
            if token not in ("on", "at", "outof") and any(place.is_bare_table for place in places):
                self.reading.unknown.append(f"{token} the table")
            request.relations.append((token, places))
            return request
        if token in {*SWAPPING, *ORDERS, *FIRST, *AFTER, *LAST}:
            # A word about the request as a whole
            self.at += 1
            request.verb = token if token in SWAPPING else request.verb
            request.orders |= {token} & ORDERS
            request.first |= token in FIRST
            self.when |= {token} & {*AFTER, *LAST}
            following = " ".join(self.tokens[self.at : self.at + 1])
            if request.relations and token in {*AFTER, *LAST} and following in PREPOSITIONS:
                self.reading.unknown.append(f"{token} {following}")  # a second place, but goals hold only at the end
            return request
        phrase = self._read_phrase()
        if phrase is None:
            self.at += 1
            if token in IMPOSSIBLE:
                self.reading.impossible.append(token)
            elif token not in _IDLE and token != ",":
                self.reading.unknown.append(token)
            return request
        if request.relations and request.verb not in CLEARING:
            request = self._append_request(Request(request.verb, orders=request.orders, heading=request.heading))
        if request.movers and self.when:
            request.orders.add("inorder")
            self.when.clear()
        request.movers.append(phrase)
        return request

    def _read_phrase(self) -> Phrase | None:
        """Parse a noun phrase; None if the next word belongs to none."""
        phrase, begin = Phrase(), self.at
        while self.at < len(self.tokens):
            extended = self._extend_phrase(phrase, self.tokens[self.at])
            if extended is None:
                break
            phrase = extended
            self.at += 1
        if phrase.article in ("the", "a") and not phrase.has_referent and not (phrase.colors or phrase.sizes):
            if self.at < len(self.tokens) and self.tokens[self.at].isalpha():
                word = self.tokens[self.at]
                self.at += 1
                if word not in PREPOSITIONS | KNOWN | ORDERS | {"and"}:
                    self.reading.unknown.append(word)
                    return replace(phrase, unknown=(word,))
                self.at -= 1
            return replace(phrase, pronoun="one")
        if phrase.sizes and not (phrase.article or phrase.colors or phrase.has_referent):
            self.reading.unknown += self.tokens[begin : self.at]  # "laid flat": a manner, not a selection
            return None
        return phrase if self.at > begin else None

    def _extend_phrase(self, phrase: Phrase, token: str) -> Phrase | None:
        """The phrase with its next word; None if the word belongs to none."""
        following = next(iter(self.tokens[self.at + 1 : self.at + 2]), ",")
        if token in _ARTICLES:
            if phrase.has_referent or phrase.colors:
                return None
            if token in ("each", "all", "both", "every"):
                if following in PREPOSITIONS | {",", "and"} | ORDERS:
                    return replace(phrase, pronoun=token)
                number = 2 if token == "both" else phrase.number
                return replace(phrase, article="each" if token in ("each", "every") else "all", number=number)
            if phrase.article in ("all", "each"):
                return phrase
            article = "each" if token in ("its", "their") else "the" if token == "the" else "a"
            return replace(phrase, article=article)
        # Counts
        if token == "of" and phrase.has_referent and make_singular(following) in self.nouns | set(COLORS):
            return phrase
        if token.isdigit():
            return replace(phrase, number=int(token))
        # Number words, colours and sizes precede their noun.
        is_juice = following == "juice" and "juice" in self.nouns  # a colour in a name: orange juice
        if not phrase.has_referent:
            if token in _NUMBERS:
                return replace(phrase, number=_NUMBERS.index(token))
            if token in COLORS and not (token == "orange" and is_juice):
                return replace(phrase, colors=(*phrase.colors, token))
            if token in _SELECTING:
                return replace(phrase, sizes=(*phrase.sizes, _SELECTING[token]))
            if token in _PLAIN and phrase.article:
                return replace(phrase, vacant=phrase.vacant or token in ("empty", "free"))
        # Pronouns and nouns
        word = make_singular(token)
        if token in OTHERS or (token in PRONOUNS and not phrase.has_referent):
            return replace(phrase, pronoun=token)
        named = word in self.nouns and (word not in COLORS or (word == "orange" and is_juice))
        if named or word in GENERIC or token == "table":
            plurals = (*phrase.plurals, word) if word != token else phrase.plurals
            return replace(phrase, nouns=(*phrase.nouns, word), plurals=plurals)
        return None


_ARTICLES = {"the", "a", "an", "its", "their", "every", "each", "all", "both", "any"}
