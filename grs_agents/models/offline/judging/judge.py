"""The role ``judge`` by rules: all requests of the words happen, goals ask for them, and nothing else moves.

It abstains if it does not know a word.
"""

import json
import re
from collections.abc import Sequence
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
    ParsedWords,
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
        _require_scene_matches_reading(read_request_words(prompt.section_body("words"), scene.nouns), scene)
        for line in prompt.section_body("further words").splitlines():  # name: ... or goal 1 and 2: ...
            if (saying := _SAYING.fullmatch(line.strip())) is None:
                continue
            numbers = {int(number) for number in re.findall(r"\d+", saying["numbers"] or "")}
            if fault := _find_contradiction(saying["text"], numbers, scene):
                raise Differs(f"{saying['who']} says {saying['text']!r}: {fault}")
    except (Differs, Unclear) as problem:
        verdict, reason = "differs" if isinstance(problem, Differs) else "unclear", str(problem)
    return f"```json\n{json.dumps({'verdict': verdict, 'reason': reason}, ensure_ascii=False)}\n```"


def _require_scene_matches_reading(reading: ParsedWords, scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless the scene agrees with the parsed words."""
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
    """Fault of a line; ``numbers`` are those of its goals, none for the name of the task.

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
    read = [
        _find_moved_things(phrase, scene, named, whole)
        for phrase in request.movers
        if bool(phrase.nouns) and not phrase.has_no_specific_noun and not phrase.is_bare_table
    ]
    fault = next(filter(None, (fault for _, fault in read)), "")
    if fault or not whole:
        return fault
    for phrase in (phrase for _, phrases in request.relations for phrase in phrases):
        known = phrase.is_bare_table or phrase.pronoun or phrase.has_no_specific_noun or {*phrase.unknown} & _NO_THINGS
        if not known and not scene.find(phrase):
            return f"there is no such thing as {phrase.text}"
    return _explain_wrong_end_pose(request, [thing for things, _ in read for thing in things], scene)


def _find_moved_things(phrase: Phrase, scene: Scene, named: bool, whole: bool) -> tuple[list[Thing], str]:
    """Objects of a phrase that move, and the reason if there are none.

    A name joins words without articles, and may name only the place of objects.
    """
    meant = scene.find(phrase) or (
        [thing for noun in phrase.nouns for thing in scene.find(Phrase((noun,)))] if named else []
    )
    if not meant:
        return [], f"there is no such thing as {phrase.text}" if whole and not named else ""
    moved = [thing for thing in meant if bool(thing.goals) and (thing.has_moved or thing.turned > 0)]
    places = {place for thing in scene.things.values() for goal in thing.goals for row in goal for _, place in row}
    still = not moved and not any(thing.fixed or thing.id in places for thing in meant)
    return moved, f"{meant[0].label} is not moved" if still else ""


def _explain_wrong_end_pose(request: Request, moved: Sequence[Thing], scene: Scene) -> str:
    """Fault of the final poses, if it applies to every object that the words may mean."""
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
