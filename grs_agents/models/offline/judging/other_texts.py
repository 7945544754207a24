"""Further words that people see, the task's name and the sentences of its goals: they may say less, never otherwise."""

import re
from collections.abc import Iterator, Sequence

from grs_agents.models.offline.judging.places import Differs, explain_misplacement
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
from grs_agents.models.offline.judging.scene import Scene, Thing

_SAYING = re.compile(r"(?P<who>name|goals? (?P<numbers>[\d and]+)): (?P<text>.*)")
_NO_THINGS = split_into_word_set(
    "place places spot position side sides corner middle center centre edge left right row line order end top bottom "
    "back front stack pile tower robot base area part table task job goal rest way same table one ones own respective"
)
"""Words of places that are no thing."""


def require_texts_match_scene(lines: Sequence[str], scene: Scene) -> None:
    """Raises ``Differs`` where a line contradicts what happens: ``name: ...`` or ``goal 1 and 2: ...``."""
    for line in lines:
        if (said := _SAYING.fullmatch(line.strip())) is None:
            continue
        numbers = {int(number) for number in re.findall(r"\d+", said["numbers"] or "")}
        if fault := _find_contradiction(said["text"], numbers, scene):
            raise Differs(f"{said['who']} says {said['text']!r}: {fault}")


def _find_contradiction(text: str, numbers: set[int], scene: Scene) -> str:
    """What is wrong with one line; ``numbers`` are those of its goals, none for the name of the task.

    Where there are words that are not understood, no more is asked than that what it moves does move.
    """
    reading = read_request_words(text, scene.nouns)
    if reading.impossible:
        return f"this robot cannot {reading.impossible[0]}"
    requests = [one for one in resolve_pronouns(reading.requests) if one.verb not in CLEARING]
    faults = (_explain_contradicted_request(request, scene, not numbers, not reading.unknown) for request in requests)
    if fault := next(filter(None, faults), ""):
        return fault
    return "" if reading.unknown or not numbers else _explain_things_of_other_goals(requests, numbers, scene)


def _explain_things_of_other_goals(requests: Sequence[Request], numbers: set[int], scene: Scene) -> str:
    """Whether a sentence speaks of none of the things of its goals, but of others."""
    moving = [request for request in requests if request.verb not in LEAVING]
    found = [scene.find(phrase) for request in moving for phrase in request.movers if phrase.nouns]
    things = [thing for row in found for thing in row]
    own = any(numbers & {*thing.asked_by} for thing in things)
    return "it speaks of other things than its goal" if things and not own else ""


def _explain_contradicted_request(request: Request, scene: Scene, named: bool, whole: bool) -> str:
    """What is wrong with one request; ``whole``: all its words are understood."""
    if request.verb in PUSHING and not scene.pushes:
        return f"the robot does not {request.verb} anything"
    if request.verb in LEAVING:
        return next(filter(None, (_explain_unexpected_move(phrase, scene) for phrase in request.movers)), "")
    read = [_find_moved_things(phrase, scene, named, whole) for phrase in request.movers if _has_specific_noun(phrase)]
    fault = next(filter(None, (fault for _, fault in read)), "")
    return fault or (_explain_contradicted_places(request, read, scene) if whole else "")


def _explain_contradicted_places(request: Request, read: Sequence[tuple[list[Thing], str]], scene: Scene) -> str:
    places = [phrase for _, phrases in request.relations for phrase in phrases]
    moved = [thing for found, _ in read for thing in found]
    return next(_explain_missing_places(places, scene), "") or _explain_wrong_end_pose(request, moved, scene)


def _has_specific_noun(phrase: Phrase) -> bool:
    return bool(phrase.nouns) and not phrase.has_no_specific_noun and not phrase.is_bare_table


def _explain_unexpected_move(phrase: Phrase, scene: Scene) -> str:
    found = [thing for thing in scene.find(phrase) if not thing.fixed]
    moves = bool(found) and phrase.pronoun not in OTHERS and all(thing.has_moved for thing in found)
    return f"{phrase.text} moves" if moves else ""


def _find_moved_things(phrase: Phrase, scene: Scene, named: bool, whole: bool) -> tuple[list[Thing], str]:
    """What a phrase may mean of all that moves, and what speaks against there being any.

    A name runs words together without articles, and may name the place of things alone.
    """
    found = scene.find(phrase) or (_find_things_by_noun(phrase, scene) if named else [])
    if not found:
        return [], f"there is no such thing as {phrase.text}" if whole and not named else ""
    moved = [thing for thing in found if _is_moved_toward_goal(thing)]
    still = not moved and not any(_is_goal_place(thing, scene) for thing in found)
    return moved, f"{found[0].label} is not moved" if still else ""


def _find_things_by_noun(phrase: Phrase, scene: Scene) -> list[Thing]:
    return [thing for noun in phrase.nouns for thing in scene.find(Phrase((noun,)))]


def _is_moved_toward_goal(thing: Thing) -> bool:
    return bool(thing.goals) and (thing.has_moved or thing.turned > 0)


def _is_goal_place(thing: Thing, scene: Scene) -> bool:
    """Whether a thing is a place, or a goal names it as one."""
    wanted = (row for other in scene.things.values() for goal in other.goals for row in goal)
    return thing.fixed or any(number == thing.id for row in wanted for _, number in row)


def _explain_missing_places(places: Sequence[Phrase], scene: Scene) -> Iterator[str]:
    for phrase in places:
        known = phrase.is_bare_table or phrase.pronoun or phrase.has_no_specific_noun or {*phrase.unknown} & _NO_THINGS
        if not known and not scene.find(phrase):
            yield f"there is no such thing as {phrase.text}"


def _explain_wrong_end_pose(request: Request, moved: Sequence[Thing], scene: Scene) -> str:
    """What is wrong with where things end, if it is wrong for each that the words may mean."""
    if not moved:
        return ""
    if request.verb in SWAPPING and not any(map(_has_goal_at_vacated_place, moved)):
        return f"{moved[0].label} does not end where another thing stood"
    if request.verb in ("stack", "pile") and not any(thing.ends for thing in moved):
        return f"{moved[0].label} ends on nothing"
    return _explain_misplaced_things(request, moved, scene)


def _explain_misplaced_things(request: Request, moved: Sequence[Thing], scene: Scene) -> str:
    phrases = [phrase for _, phrases in request.relations for phrase in phrases]
    if any(phrase.unknown for phrase in phrases):
        return ""
    faults = [explain_misplacement(thing, request, (None,) * len(phrases), scene) for thing in moved]
    return faults[0] if all(faults) else ""


def _has_goal_at_vacated_place(thing: Thing) -> bool:
    return any(how == "where" for goal in thing.goals for row in goal for how, _ in row)
