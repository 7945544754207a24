"""A fix of the tests is told by the assertions that it took away, and by what came in their place."""

import pytest

from grs_agents.audit.assertion_changes import find_changed_assertions

OLD = """\
class T:
    def test(self):
        self.assertEqual(len(goals), 2, "two goals")
        assert goals
"""


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("assert goals", "assert goals, 'none'"), ()),  # messages do not count
        (("assert goals", "assert goals\n        self.assertTrue(goals)"), ()),  # more is asserted, nothing is lost
        (('self.assertEqual(len(goals), 2, "two goals")', "pass"), ("- assertEqual(len(goals), 2)",)),
        (
            ("assertEqual(len(goals), 2", "assertGreater(len(goals), 0"),
            ("- assertEqual(len(goals), 2)", "+ assertGreater(len(goals), 0)"),
        ),
        (("assert goals", "assert goals ("), ()),  # no Python
    ],
)
def test_what_is_no_longer_asserted_is_listed_before_what_is_asserted_instead(
    change: tuple[str, str], told: tuple[str, ...]
) -> None:
    assert find_changed_assertions(OLD, OLD.replace(*change)) == told
