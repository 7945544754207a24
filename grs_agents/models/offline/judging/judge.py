"""The role ``judge`` by rules: the words' requests all happen, goals ask for them, and nothing else moves.

It abstains if it does not know a word.
"""

import json
import re
from itertools import islice, product

from grs_agents.models.offline.judging.checks import require_requests_are_met
from grs_agents.models.offline.judging.places import (
    Differs,
    Unclear,
    explain_misplacement,
    list_place_combinations,
)
from grs_agents.models.offline.judging.reading import (
    CLEARING,
    LEAVING,
    OTHERS,
    PUSHING,
    SWAPPING,
    Phrase,
    Request,
    read_request_words,
    resolve_pronouns,
    split_into_word_set,
)
from grs_agents.models.offline.judging.scene import Scene, Thing, parse_scene
from grs_agents.models.offline.prompt_text import PromptText

_MOST_READINGS = 400
"""Most interpretations of the places that are tried."""
_AGREES = "all that the words move ends where they say, each goal asks for it, and nothing else moves"

_SAYING = re.compile(r"(?P<who>name|goals? (?P<numbers>[\d and]+)): (?P<text>.*)")
_NO_THINGS = split_into_word_set(
    "place places spot position side sides corner middle center centre edge left right row line order end top bottom "
    "back front stack pile tower robot base area part table task job goal rest way same table one ones own respective"
)
"""Words of places that name no object."""


def judge_words(prompt: PromptText) -> str:
    """Reply to the ``judge`` prompt."""
    scene = parse_scene(prompt.section_json_rows("objects"), prompt.section_body("goals"))
    verdict, reason = "agrees", _AGREES
    try:
        _require_scene_matches_words(prompt.section_body("words"), scene)
        for line in prompt.section_body("further words").splitlines():  # name: ... or goal 1 and 2: ...
            if (saying := _SAYING.fullmatch(line.strip())) is None:
                continue
            numbers = {int(number) for number in re.findall(r"\d+", saying["numbers"] or "")}
            if fault := _find_contradiction(saying["text"], numbers, scene):
                raise Differs(f"{saying['who']} says {saying['text']!r}: {fault}")
    except (Differs, Unclear) as problem:
        verdict, reason = "differs" if isinstance(problem, Differs) else "unclear", str(problem)
    return f"```json\n{json.dumps({'verdict': verdict, 'reason': reason}, ensure_ascii=False)}\n```"


def _require_scene_matches_words(words: str, scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless the scene agrees with the words."""
    reading = read_request_words(words, scene.nouns)
    if reading.impossible:
        raise Differs(f"the words ask to {reading.impossible[0]}, which this robot cannot do")
    if reading.unknown:
        raise Unclear(f"these words are not understood: {', '.join(dict.fromkeys(reading.unknown))}")
    if not reading.requests:
        raise Unclear("the words ask for nothing that is understood")
    requests = resolve_pronouns(reading.requests)
    if scene.pushes != any(request.verb in PUSHING for request in requests):
        raise Differs(f"the robot {'pushes' if scene.pushes else 'picks and places'}, the words ask for something else")
    problem: Differs | None = None
    for places in islice(product(*(list_place_combinations(request, scene) for request in requests)), _MOST_READINGS):
        try:
            require_requests_are_met(requests, places, scene)
        except Differs as difference:
            problem = problem or difference
        else:
            return
    raise problem or Unclear("what the places are is not understood")


def _find_contradiction(text: str, numbers: set[int], scene: Scene) -> str:
    """Fault of a line; ``numbers`` are its goals' numbers, empty for the name of the task.

    If words are unknown, only the motion of the named objects is checked.
    """
    reading = read_request_words(text, scene.nouns)
    if reading.impossible:
        return f"this robot cannot {reading.impossible[0]}"
    requests = [request for request in resolve_pronouns(reading.requests) if request.verb not in CLEARING]
    faults = (_explain_contradicted_request(request, scene, not numbers, not reading.unknown) for request in requests)
    if fault := next(filter(None, faults), ""):
        return fault
    if reading.unknown or not numbers:
        return ""
    phrases = [phrase for request in requests if request.verb not in LEAVING for phrase in request.movers]
    things = [thing for phrase in phrases if phrase.nouns for thing in scene.find(phrase)]
    elsewhere = things and not any(numbers & {*thing.asked_by} for thing in things)
    return "it speaks of other things than its goal" if elsewhere else ""


def _explain_contradicted_request(request: Request, scene: Scene, named: bool, whole: bool) -> str:
    """Fault of a request; ``whole``: all its words are known."""
    if request.verb in PUSHING and not scene.pushes:
        return f"the robot does not {request.verb} anything"
    if request.verb in LEAVING:
        for phrase in request.movers:
            loose = [thing for thing in scene.find(phrase) if not thing.fixed]
            if loose and phrase.pronoun not in OTHERS and all(thing.has_moved for thing in loose):
                return f"{phrase.text} moves"
        return ""
    moved: list[Thing] = []
    places = {place for thing in scene.things.values() for goal in thing.goals for row in goal for _, place in row}
    for phrase in request.movers:
        if not phrase.nouns or phrase.has_no_specific_noun or phrase.is_bare_table:
            continue
        meant = scene.find(phrase)
        if not meant and named:  # a name joins words without articles, and may name only the place of objects
            meant = [thing for noun in phrase.nouns for thing in scene.find(Phrase((noun,)))]
        if not meant and whole and not named:
            return f"there is no such thing as {phrase.text}"
        moving = [thing for thing in meant if bool(thing.goals) and (thing.has_moved or thing.turned > 0)]
        if meant and not moving and not any(thing.fixed or thing.id in places for thing in meant):
            return f"{meant[0].label} is not moved"
        moved += moving
    if not whole:
        return ""
    for phrase in (phrase for _, phrases in request.relations for phrase in phrases):
        known = phrase.is_bare_table or phrase.pronoun or phrase.has_no_specific_noun or {*phrase.unknown} & _NO_THINGS
        if not known and not scene.find(phrase):
            return f"there is no such thing as {phrase.text}"
    # Final poses, at fault only if the fault applies to every object that the words may mean
    if not moved:
        return ""
    references = [reference for thing in moved for goal in thing.goals for row in goal for reference in row]
    if request.verb in SWAPPING and not any(how == "where" for how, _ in references):
        return f"{moved[0].label} does not end where another thing stood"
    if request.verb in ("stack", "pile") and not any(thing.ends for thing in moved):
        return f"{moved[0].label} ends on nothing"
    phrases = [phrase for _, phrases in request.relations for phrase in phrases]
    if any(phrase.unknown for phrase in phrases):
        return ""
    faults = [explain_misplacement(thing, request, (None,) * len(phrases), scene) for thing in moved]
    return faults[0] if all(faults) else ""
