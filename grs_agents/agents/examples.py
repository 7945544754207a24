"""The example programs, and the selection of the programs nearest to a task.

An example is a simulation program in ``prompts/examples``. Its module docstring begins with its family, a colon and its
subject: ``Stacking: a tower on a stand that lies anywhere``.
"""

import ast
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from grs_agents.agents.types import TaskDefinition
from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.python_parsing import parse_python

_PER_FAMILY = 2
"""Most programs of a family among the chosen examples: a third adds little."""
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_ENDINGS = ("ing", "ed", "es", "s", "e")
_SHORTEST = 3


class Example(Frozen):
    """An example program."""

    name: str  # of its file, without the suffix
    family: str  # the kind of task, e.g. `"Stacking"`
    shows: str  # its subject
    source: str

    @property
    def word_stem_counts(self) -> Counter[str]:
        """Stems of the words in its names, docstrings, sentences and assets, without the code."""
        texts = [self.name]
        for node in ast.walk(parse_python(self.source)):
            if isinstance(node, ast.ClassDef):
                texts.append(node.name)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
        return _count_word_stems(texts)


def read_examples(folder: Path) -> tuple[Example, ...]:
    """Every example of a folder, by name."""
    examples: list[Example] = []
    for file in sorted(folder.glob("*.py")):
        source = file.read_text(encoding="utf-8").strip()
        try:
            family, _, shows = (ast.get_docstring(parse_python(source)) or "").partition(": ")
        except SyntaxError as error:
            raise InputError(f"example {file.name} is no Python program: {error}", "correct it") from error
        examples.append(Example(name=file.stem, family=family, shows=shows, source=source))
    if not examples:
        raise InputError(f"{folder} holds no example program", "reinstall grs-agents")
    return tuple(examples)


def select_nearest_examples(
    examples: Sequence[Example], task: TaskDefinition, count: int, seed: int
) -> tuple[Example, ...]:
    """Select the examples nearest to a task's name, description and assets, the nearest first.

    Similarity is the cosine of tf-idf vectors. At most two examples are of the same family. Ties are broken by the
    seed.
    """
    bags = [example.word_stem_counts for example in examples]
    having = Counter(word for bag in bags for word in bag)
    rarity = {word: math.log((1 + len(bags)) / number) for word, number in having.items()}
    wanted = _count_word_stems([task.name, task.description, *task.assets])
    near = [round(_tfidf_cosine_similarity(bag, wanted, rarity), 9) for bag in bags]
    order = sorted(range(len(bags)), key=lambda index: (-near[index], (index - seed) % len(bags)))
    chosen: list[Example] = []
    for index in order:
        fellows = sum(example.family == examples[index].family for example in chosen)
        if fellows < _PER_FAMILY and len(chosen) < count:
            chosen.append(examples[index])
    return tuple(chosen)


def _tfidf_cosine_similarity(first: Counter[str], second: Counter[str], rarity: dict[str, float]) -> float:
    def compute_tfidf_weights(bag: Counter[str]) -> dict[str, float]:
        return {word: (1 + math.log(number)) * rarity.get(word, 0.0) for word, number in bag.items()}

    left, right = compute_tfidf_weights(first), compute_tfidf_weights(second)
    length = math.hypot(*left.values()) * math.hypot(*right.values())
    return sum(left[word] * right[word] for word in left.keys() & right.keys()) / length if length else 0.0


def _count_word_stems(texts: Iterable[str]) -> Counter[str]:
    """Count words without their endings, so that "stacking", "stacked" and "stack" are equal; CamelCase is split."""
    stems = Counter[str]()
    for word in (word for text in texts for word in _WORD.findall(text)):
        spelt = word.lower().replace("colour", "color")
        ending = next((ending for ending in _ENDINGS if spelt.endswith(ending)), "")
        stems[spelt.removesuffix(ending) if len(spelt) - len(ending) >= _SHORTEST else spelt] += 1
    return stems
