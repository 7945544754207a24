"""The role ``judge`` by rules: does everything that the words ask for happen, is it asked for, and nothing else?

It abstains where it does not understand a word.
"""

import json
from itertools import islice, product

from grs_agents.models.offline.judging.checks import require_requests_are_met
from grs_agents.models.offline.judging.other_texts import require_texts_match_scene
from grs_agents.models.offline.judging.places import Differs, Unclear, list_place_combinations
from grs_agents.models.offline.judging.reading import PUSHING, Reading, read_request_words, resolve_pronouns
from grs_agents.models.offline.judging.scene import Scene, parse_scene
from grs_agents.models.offline.prompt_text import PromptText

_MOST_READINGS = 400
"""How many choices of what the places may be are tried."""
_AGREES = "all that the words move ends where they say, each goal asks for it, and nothing else moves"


def judge_words(prompt: PromptText) -> str:
    """Reply to the ``judge`` prompt."""
    scene = parse_scene(prompt.section_json_rows("objects"), prompt.section_body("goals"))
    verdict, reason = "agrees", _AGREES
    try:
        _require_scene_matches_reading(read_request_words(prompt.section_body("words"), scene.nouns), scene)
        require_texts_match_scene(prompt.section_body("further words").splitlines(), scene)
    except (Differs, Unclear) as problem:
        verdict, reason = "differs" if isinstance(problem, Differs) else "unclear", str(problem)
    return f"```json\n{json.dumps({'verdict': verdict, 'reason': reason}, ensure_ascii=False)}\n```"


def _require_scene_matches_reading(reading: Reading, scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless the scene shows what was read."""
    _require_words_are_understood(reading)
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


def _require_words_are_understood(reading: Reading) -> None:
    if reading.impossible:
        raise Differs(f"the words ask to {reading.impossible[0]}, which this robot cannot do")
    if reading.unknown:
        raise Unclear(f"these words are not understood: {', '.join(dict.fromkeys(reading.unknown))}")
    if not reading.requests:
        raise Unclear("the words ask for nothing that is understood")
