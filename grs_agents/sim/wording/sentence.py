"""The sentence that a task comes to: all that its goals ask for, and nothing else."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import LONGEST_INSTRUCTION, TaskInstance
from grs_agents.sim.wording.noun_phrases import NounPhrases, count_in_words, join_with_and, pluralize
from grs_agents.sim.wording.places import Place, PlacePhrases
from grs_agents.sim.wording.table_state import TableState, predict_final_poses

_IN_ROW: Final = 0.015
"""Largest offset (m) of a centre from the line of a row."""
_ROW_STEP: Final = 0.03
"""Least distance (m) of two neighbours in a row."""
_SKEWED: Final = 0.5
"""Largest slope of a row on a support, which may be turned, against the direction that it is described by."""
_PAIR_STEP: Final = 0.15
"""Largest distance (m) of a pair on the bare table that counts as a row."""
_LONGEST_LIST: Final = 6
"""Places of a goal that are listed; of more, their number is stated."""
_SIDES: Final = re.compile(r"\b(left|right|leftmost|rightmost|behind|in front of|near|far)\b")
_IN_OR_ON: Final = re.compile(r"(in|on) (?!front)")
_SIDES_NOTE: Final = "Sides are as the robot sees them."


@dataclass(frozen=True)
class Clause:
    """A part of the sentence: objects that end at the same place, or in an arrangement."""

    verb: str  # ``put``, ``move``, ``turn``, ``stack``, ``line up``, ``stand``
    objects: tuple[int, ...]
    text: str  # the phrase after the objects of ``put``; of other verbs the whole clause without the verb
    goal: int
    references: tuple[int, ...] = ()  # ids of the objects in the text
    turn: str = ""
    place: Place | None = None  # of a single object with a pose


@dataclass(frozen=True)
class Vocabulary:
    """Verbs and joints of a sentence; another vocabulary is a paraphrase with the same meaning."""

    verbs: Mapping[str, str]  # in place of those of clauses
    then: str = ", then "
    first: str = "first "
    rest: str = "; nothing else moves."  # the end of a sentence


_PLAIN: Final = Vocabulary({})
_PARAPHRASES: Final = (
    Vocabulary(
        {"put": "place", "move": "shift", "turn": "rotate", "stack": "place", "line up": "align", "push": "slide"},
        ", and then ",
        "",
        ", and leave everything else where it is.",
    ),
    Vocabulary(
        {"put": "set", "move": "bring", "turn": "rotate", "stack": "set", "line up": "arrange", "stand": "set"},
        "; after that, ",
        "",
        ". All other objects stay where they are.",
    ),
    Vocabulary(
        {"put": "please put", "move": "please move", "turn": "please turn", "stack": "please stack"}
        | {"line up": "please line up", "stand": "please stand", "push": "please push"},
        ", afterwards ",
        "to begin with, ",
        " without moving anything else.",
    ),
)


@dataclass(frozen=True)
class TaskSentence:
    """A task in words of trusted code."""

    specific: str  # true and complete
    vague: str  # true, without names of single objects


def describe_task(
    instance: TaskInstance,
    library: Library,
    initial: Mapping[int, Pose] | None = None,
    final: Mapping[int, Pose] | None = None,
) -> TaskSentence:
    """Describe a task instance by its goals.

    Args:
        instance: the instance; the program's own sentences are not used.
        library: source of its assets.
        initial: pose of each object at the start (m, robot frame); by default those of the instance.
        final: measured pose of each object at the end; by default those that pose goals fix.
    """
    initial = {item.id: item.pose for item in instance.objects} if initial is None else initial
    table = TableState(instance, library, initial, predict_final_poses(instance) if final is None else final)
    writer = _Writer(table, measured=final is not None)
    return TaskSentence(writer.write_specific()[:LONGEST_INSTRUCTION], writer.write_vague())


def paraphrase_task(instance: TaskInstance, library: Library) -> tuple[str, ...]:
    """Three other sentences with the meaning of `describe_task`, by other verbs and joints."""
    initial = {item.id: item.pose for item in instance.objects}
    table = TableState(instance, library, initial, predict_final_poses(instance))
    return tuple(
        _Writer(table, measured=False, vocabulary=vocabulary).write_specific()[:LONGEST_INSTRUCTION]
        for vocabulary in _PARAPHRASES
    )


@dataclass(frozen=True)
class _Writer:
    table: TableState
    measured: bool
    vocabulary: Vocabulary = _PLAIN

    @cached_property
    def nouns(self) -> NounPhrases:
        return NounPhrases(self.table)

    @cached_property
    def places(self) -> PlacePhrases:
        return PlacePhrases(self.table, self.nouns)

    @property
    def _pushes(self) -> bool:
        return self.table.instance.primitive == "push"

    @cached_property
    def stages(self) -> list[list[Clause]]:
        """The clauses in the order that the program demands; those of a stage have none."""
        clauses = [
            clause for index, goal in enumerate(self.table.instance.goals) for clause in self._list_clauses(index, goal)
        ]
        stage_of_goal: dict[int, int] = {}
        stages: list[list[Clause]] = []
        for index in range(len(self.table.instance.goals)):
            own = [clause for clause in clauses if clause.goal == index]
            before = [clause for clause in clauses if clause.goal < index]
            after = [
                stage_of_goal[earlier.goal]
                for earlier in before
                if any(_is_order_forced(earlier, later) for later in own)
            ]
            stage_of_goal[index] = stage = max(after, default=-1) + 1
            stages += [[] for _ in range(stage + 1 - len(stages))]
            stages[stage] += own
        return [list(self._join_rows(stage)) for stage in stages if stage]

    def write_specific(self) -> str:
        """The whole sentence."""
        steps = [self._write_stage(stage) for stage in self.stages]
        text = self.vocabulary.then.join(steps)
        if len(steps) > 2:
            text = f"{self.vocabulary.first}{text}"
        moving = {number for stage in self.stages for clause in stage for number in clause.objects}
        others = sorted(self.table.displaced - moving) if self.measured else []
        also = (
            f"{join_with_and(self.nouns.count_together(others))} {'moves' if len(others) == 1 else 'move'}, too; "
            if others
            else ""
        )
        end = f"; {also}nothing else does." if also else self.vocabulary.rest
        text = f"{text[:1].upper()}{text[1:]}{end}"
        added = sorted(
            {
                number
                for stage in self.stages
                for clause in stage
                for number in (*clause.objects, *clause.references)
                if self.table.items[number].added
            }
        )
        if added:
            names = self.nouns.count_together(added)
            plural = len(added) > 1
            listed = join_with_and(names)
            text += f" {listed[:1].upper()}{listed[1:]} {'are' if plural else 'is'} not in the photo."
        return f"{text} {_SIDES_NOTE}" if _SIDES.search(text) else text

    def _word(self, verb: str) -> str:
        return self.vocabulary.verbs.get(verb, verb)

    def write_vague(self) -> str:
        """The same without names of single objects."""
        groups: dict[tuple[str, str, str], tuple[list[int], set[int]]] = {}  # objects and places
        for clause in (clause for stage in self.stages for clause in stage):
            how = _IN_OR_ON.match(clause.text) if clause.verb == "put" and clause.references else None
            place = self._kind(clause.references[0]) if how else ""
            word = "in" if how and clause.references[0] in self.table.walled else "on"
            verb = "move" if clause.verb == "put" and not how else clause.verb
            verb = "push" if self._pushes and verb in ("put", "move") else verb
            objects, places = groups.setdefault((verb, word if how else "", place), ([], set()))
            objects += [number for number in clause.objects if number not in objects]
            places.update(clause.references[:1])
        steps: list[str] = []
        for (verb, how, place), (objects, places) in groups.items():
            kinds = {self._kind(number) for number in objects}
            kind = kinds.pop() if len(kinds) == 1 else "thing"
            counted = f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"
            if len(objects) > 1:
                counted = f"{count_in_words(len(objects))} {pluralize(kind)}"
            where = f"the {place}" if len(places) == 1 else f"{count_in_words(len(places))} {pluralize(place)}"
            steps.append(f"{verb} {counted}{f' {how} {where}' if how else ''}")
        text = join_with_and(steps)
        return f"{text[:1].upper()}{text[1:]}."

    def _kind(self, number: int) -> str:
        return self.table.names[number].split()[-1]

    def _list_clauses(self, index: int, goal: Goal) -> Iterator[Clause]:
        if goal.relation is not None:
            yield self._make_relation_clause(index, goal)
            return
        alike: dict[tuple[str, str], Clause] = {}
        for row, number in enumerate(goal.objects):
            if goal.metric == "zone":
                options = [self.places.describe_zone(zone, number) for zone in goal.zones]
            else:
                allowed = goal.allowed_target_indices(row)
                options = [
                    self.places.describe_target(goal.targets[target], number, len(allowed) == 1) for target in allowed
                ]
            different = list({option.text: option for option in options}.values())
            references = tuple(dict.fromkeys(part for option in different for part in option.references))
            turn = self.places.describe_turn(goal, row)
            if len(different) == 1:
                (place,) = different
                clause = self._make_place_clause(index, number, place, turn, goal.metric == "pose")
            else:
                text = self._list_options(different, goal, len(options))
                clause = Clause("put", (number,), text, index, references, turn)
            same = alike.get((clause.verb, clause.text)) if clause.verb == "put" and not turn else None
            if same is not None:
                clause = replace(same, objects=(*same.objects, number), place=None)
                if same.place is not None and clause.text:
                    clause = replace(clause, place=None)
            alike[(clause.verb, clause.text if clause.verb == "put" and not turn else str(number))] = clause
        yield from alike.values()

    def _make_place_clause(self, index: int, number: int, place: Place, turn: str, pose: bool) -> Clause:
        start = self.table.find_supports(self.table.start[number], self.table.start)
        again = self._are_moved_before({number, *(support for _, support in start)}, index)
        if again and turn:
            turn = f"{turn} from how it stood"
        if not place.text:  # its own place
            if turn and not again:
                return Clause("turn", (number,), f"{self.nouns.name(number)} {turn} on the spot", index)
            return Clause("put", (number,), "back where it stood", index, turn=turn)
        if place.free and again:  # lengths count from its start, not from where it is by then
            return Clause("put", (number,), f"{place.text} from where it stood", index, turn=turn, place=place)
        if place.free:
            out = f"from {self.nouns.name(start[0][1])} onto the bare table, " if start else ""
            turned = f", turned {turn}" if turn else ""
            text = f"{self.nouns.name(number)} {out}{place.text}{turned}"
            return Clause("move", (number,), text, index, tuple(ref for _, ref in start[:1]), turn, place)
        below = place.references[0] if len(place.references) == 1 else None
        loose = below is not None and below not in self.table.hollow | self.table.marks
        if pose and loose and place.text.startswith("on "):
            text = f"{self._name_turned(number, turn)} {place.text}"
            return Clause("stack", (number,), text, index, place.references)
        return Clause("put", (number,), place.text, index, place.references, turn, place if pose else None)

    def _name_turned(self, number: int, turn: str) -> str:
        """``the cookie box (turned by 43 degrees clockwise)``; the bare name without a turn."""
        name = self.nouns.name(number)
        return f"{name} (turned {turn})" if turn else name

    def _are_moved_before(self, numbers: set[int], index: int) -> bool:
        """True if goals before the ``index``-th move any of the objects."""
        return any(not numbers.isdisjoint(earlier.objects) for earlier in self.table.instance.goals[:index])

    def _list_options(self, options: Sequence[Place], goal: Goal, count: int) -> str:
        """Several places of which any will do, or each for a different object."""
        shared = len(goal.objects) == 1 or goal.replace or goal.metric == "zone"
        texts = [f"{option.text} from where it stood" if option.free else option.text for option in options]
        texts = [text or "where it stood" for text in texts]
        if len(texts) > _LONGEST_LIST:
            return f"at any of {count} given places" + ("" if shared else ", each at a different one")
        if shared:
            return join_with_and(texts, "or")
        return f"{join_with_and(texts, 'or')}, each at a different one of these places"

    def _make_relation_clause(self, index: int, goal: Goal) -> Clause:
        kind, distance = goal.relation_kind, goal.required_distance
        objects = goal.objects
        if kind == "stacked":
            bottom = objects[0]
            if self._are_moved_before({bottom}, index) or not self.measured or bottom not in self.table.displaced:
                steps = [f"{self.nouns.name(above)} on {self.nouns.name(below)}" for below, above in pairwise(objects)]
                return Clause("stack", objects[1:], join_with_and(steps), index, (bottom,))
            return Clause(
                "stack", objects, f"{self.nouns.list_names(objects)}, in this order from the bottom up", index
            )
        if kind == "aligned":
            apart = f", {100 * distance:.0f} cm from centre to centre" if distance else ""
            names = join_with_and(self.nouns.count_together(objects))  # goals demand no order
            return Clause("line up", objects, f"{names} in any order{apart}", index)
        if kind == "upright":
            return Clause("stand", objects, f"{join_with_and(self.nouns.count_together(objects))} upright", index)
        reference = goal.reference_id
        name = self.nouns.name(reference)
        words = {
            "inside": f"in {name}",
            "near": f"beside {name}, at most {100 * (distance or 0):.0f} cm from it",
        }.get(str(kind), f"on {name}")
        return Clause("put", objects, words, index, (reference,))

    def _join_rows(self, clauses: Sequence[Clause]) -> Iterator[Clause]:
        """Join clauses with spots in a row on the same support into one that states their order."""
        rows: dict[tuple[int, ...], list[Clause]] = {}
        for clause in clauses:
            if clause.place is not None and clause.place.spot is not None and not clause.text.startswith("where "):
                on_support = not clause.place.free and _IN_OR_ON.match(clause.text)
                rows.setdefault(clause.references if on_support else (), []).append(clause)
        joined: dict[int, Clause | None] = {}  # by the place of a clause in the stage
        for references, members in rows.items():
            row = self._make_row(members, references)
            if row is not None:
                joined |= {clauses.index(member): None for member in members}
                joined[clauses.index(members[0])] = row
        for index, clause in enumerate(clauses):
            kept = joined.get(index, clause)
            if kept is not None:
                yield kept

    def _make_row(self, members: Sequence[Clause], references: tuple[int, ...]) -> Clause | None:
        if len(members) < 2:
            return None
        spots = {member.objects[0]: member.place.spot for member in members if member.place and member.place.spot}
        spans = [max(values) - min(values) for values in zip(*spots.values(), strict=True)]
        axis = 1 if spans[1] > spans[0] else 0
        ranked = sorted(spots, key=lambda number: spots[number][axis], reverse=axis == 1)
        steps = [math.dist(spots[first], spots[second]) for first, second in pairwise(ranked)]
        (x0, y0), (x1, y1) = spots[ranked[0]], spots[ranked[-1]]
        length = math.dist((x0, y0), (x1, y1))
        aside = [abs((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) for x, y in spots.values()]
        loose = not references and len(members) == 2 and steps[0] > _PAIR_STEP
        loose |= spans[1 - axis] > (_SKEWED * spans[axis] if references else 2 * _IN_ROW)
        if loose or max(aside) > _IN_ROW * length or min(steps) < _ROW_STEP:
            return None
        even = max(steps) - min(steps) < 0.01
        apart = f", {100 * sum(steps) / len(steps):.0f} cm from centre to centre," if even else ""
        way = "from left to right" if axis else "from near to far"
        if references:
            word = next(member.text.split()[0] for member in members)
            where = f" {word} {self.nouns.list_names(references)}"
        else:
            first = next(member for member in members if member.objects[0] == ranked[0])
            assert first.place is not None
            back = " from where it stood" if first.place.free else ""
            where = f" on the bare table (beginning with {self.nouns.name(ranked[0])} {first.place.text}{back})"
        turns = {member.objects[0]: member.turn for member in members if member.turn}
        names = [self._name_turned(number, turns.get(number, "")) for number in ranked]
        text = f"{join_with_and(names)} {way}{apart}{where}"
        return Clause("line up", tuple(ranked), text, members[0].goal, references)

    def _write_stage(self, clauses: Sequence[Clause]) -> str:
        """The clauses of a stage: those of ``put`` first, by place; a verb of several clauses stands once."""
        objects: dict[str, list[int]] = {}  # of ``put``, by place
        turned: dict[str, list[str]] = {}
        rest: dict[str, list[str]] = {}  # other clauses by verb
        for clause in clauses:
            if clause.verb == "line up":
                rest[f"{clause.verb} {clause.text}"] = [f"{self._word(clause.verb)} {clause.text}"]
            elif clause.verb != "put":
                verb = "push" if self._pushes and clause.verb == "move" else clause.verb
                text = clause.text if verb in rest else f"{self._word(verb)} {clause.text}"
                rest.setdefault(verb, []).append(text)
            elif clause.turn:
                turned.setdefault(clause.text, []).append(self._name_turned(clause.objects[0], clause.turn))
            else:
                objects.setdefault(clause.text, []).extend(clause.objects)
        puts: list[str] = []
        for place in dict.fromkeys((*objects, *turned)):
            names = self.nouns.count_together(list(dict.fromkeys(objects.get(place, ()))))
            puts.append(f"{join_with_and([*names, *turned.get(place, ())])} {place}")
        parts = [f"{self._word('push' if self._pushes else 'put')} {_join_parts(puts)}"] if puts else []
        return _join_parts([*parts, *(_join_parts(texts) for texts in rest.values())])


def _join_parts(parts: Sequence[str]) -> str:
    """``a, and b``: a comma keeps apart parts that hold lists."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])}, and {parts[-1]}"


def _is_order_forced(earlier: Clause, later: Clause) -> bool:
    """True if a later goal moves the same object, moves what carries it, or refers to what an earlier goal moves."""
    moved, moves = set(earlier.objects), set(later.objects)
    return bool(moved & (moves | set(later.references)) or set(earlier.references) & moves)
