"""Counts dialect in docstrings and docs, and draws docstrings, comments and names for a person to judge.

python scripts/prose.py                      # words per 1,000, by package and for docs
python scripts/prose.py --draw 40 --seed 1   # 40 docstrings and comments
python scripts/prose.py --names 100 --seed 1 # 100 names of functions, classes and constants
"""

import argparse
import ast
import io
import random
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "grs_agents"
WORDS = ("what", "one", "ones", "where", "stands")
BOUNDS = {"what": 3.0, "one": 3.0}
"""Occurrences per 1,000 words; "one" counts "ones" too."""


def docstrings(tree: ast.Module) -> Iterator[str]:
    """The docstrings of a module and of all in it, those below assignments too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value.value


def comments(source: str) -> Iterator[str]:
    """The comments of a module, a run of lines as one."""
    lines: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            lines[token.start[0]] = token.string.lstrip("# ")
    for number, first in lines.items():
        if number - 1 not in lines:
            run = [first]
            while number + len(run) in lines:
                run.append(lines[number + len(run)])
            yield " ".join(run)


def pages() -> dict[str, str]:
    """The text of each page of the documentation and of the README, without code blocks."""
    files = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return {file.name: re.sub(r"```.*?```|`[^`]*`", "", file.read_text("utf-8"), flags=re.DOTALL) for file in files}


def rates(texts: Iterator[str] | list[str]) -> tuple[dict[str, float], int]:
    """Occurrences of each of WORDS per 1,000 words, and the number of words."""
    words = Counter(word for text in texts for word in re.findall(r"[a-z']+", text.lower()))
    total = sum(words.values())
    return {word: 1000 * words[word] / max(total, 1) for word in WORDS}, total


def names(tree: ast.Module) -> Iterator[str]:
    """Names of the functions, classes and constants of a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
    for node in tree.body:
        if isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))


def main() -> None:
    """Print the table, or the drawn sample."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", type=int, metavar="N", help="draw N docstrings and comments")
    parser.add_argument("--names", type=int, metavar="N", help="draw N names")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    sources = {file: file.read_text("utf-8") for file in sorted(PACKAGE.rglob("*.py")) if "_bundled" not in file.parts}
    trees = {file: ast.parse(source) for file, source in sources.items()}
    draw = random.Random(chosen.seed).sample
    if chosen.draw or chosen.names:
        pool = [
            (str(file.relative_to(ROOT)), text)
            for file, tree in trees.items()
            for text in (names(tree) if chosen.names else [*docstrings(tree), *comments(sources[file])])
        ]
        print(f"seed {chosen.seed}, of {len(pool)}")
        for place, text in draw(pool, min(chosen.names or chosen.draw, len(pool))):
            print(f"- {place}: {' '.join(text.split())}")
        return
    groups: dict[str, list[str]] = {}
    for file, tree in trees.items():
        groups.setdefault(file.relative_to(PACKAGE).parts[0].removesuffix(".py"), []).extend(docstrings(tree))
    table = {name: rates(texts) for name, texts in groups.items()}
    table["docstrings"] = rates([text for texts in groups.values() for text in texts])
    table["docs"] = rates(list(pages().values()))
    print(f"{'per 1,000 words':16}" + "".join(f"{word:>9}" for word in (*WORDS, "words")))
    for name, (counts, total) in table.items():
        print(f"{name:16}" + "".join(f"{counts[word]:9.1f}" for word in WORDS) + f"{total:9d}")
    for name in ("docstrings", "docs"):
        counts, _ = table[name]
        for word, bound in BOUNDS.items():
            rate = counts[word] + (counts["ones"] if word == "one" else 0)
            print(f"{name}: {word} {rate:.1f} of at most {bound:g}{'' if rate <= bound else ': missed'}")


if __name__ == "__main__":
    main()
