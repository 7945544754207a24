"""Options shared by several verbs. The configuration is imported on use: ``--help`` does without."""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from grs_agents.base.errors import ConfigError, InputError
from grs_agents.base.terminal import VERBOSITY
from grs_agents.cli.completion import complete_cassette, complete_setting

if TYPE_CHECKING:
    from grs_agents.base.config.load import EffectiveConfig
    from grs_agents.sim.variation.types import Variation

ConfigFile = Annotated[Path | None, typer.Option("--config", help="A TOML configuration file.", metavar="FILE")]
_SET = typer.Option(
    "--set",
    help="Override one key, e.g. --set max_fixes=5. Repeatable.",
    metavar="KEY=VALUE",
    autocompletion=complete_setting,
)
Settings = Annotated[list[str] | None, _SET]
Seed = Annotated[int | None, typer.Option("--seed", help="The seed of everything random.", metavar="N")]
Robot = Annotated[
    str | None,
    typer.Option("--robot", help="The arm: ur5e, panda, menagerie:NAME or an MJCF or URDF file.", metavar="NAME"),
]
Hand = Annotated[
    str | None,
    typer.Option(
        "--hand", help="Its hand: suction, franka_hand, robotiq_2f85, or own, of the MJCF file.", metavar="NAME"
    ),
]
Models = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        help="The chat model of every role without one of its own: offline, PROVIDER:NAME or package.module:Class. "
        "Repeat it to name those to ask where it fails.",
        metavar="NAME",
    ),
]
Camera = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="The photo's intrinsics, or a sensor's name, e.g. realsense-d435, for a capture that states none.",
        metavar="FX,FY,CX,CY[,W,H]",
    ),
]
DepthScale = Annotated[
    float | None,
    typer.Option("--depth-scale", help="Metres per unit of the depth, 0.001 for millimetres.", metavar="M"),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON alone on stdout.")]
Out = Annotated[Path | None, typer.Option("--out", help="The run folder; runs/<id> by default.", metavar="DIR")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with the run in --out where it stopped.")]
Edits = Annotated[
    Path | None, typer.Option("--edits", help="Correct the scene by the edits of grs edit.", metavar="FILE")
]
Record = Annotated[Path | None, typer.Option("--record", help="Write every exchange with the models.", metavar="FILE")]
Cassette = Annotated[
    str | None,
    typer.Option(
        "--cassette",
        help="Repeat a recorded run without models: its file or name.",
        metavar="FILE",
        autocompletion=complete_cassette,
    ),
]
View = Annotated[bool, typer.Option("--view", help="Open the rerun viewer and watch the run live.")]
Otel = Annotated[bool, typer.Option("--otel", help="Send OpenTelemetry spans to where the OTEL_* variables say.")]
Workers = Annotated[int, typer.Option("--workers", help="Processes at a time.", metavar="N", min=1, max=256)]
_TASKS = typer.Option("--tasks", "-n", help="Different tasks wanted of each scene.", metavar="N", min=1, max=1000)
Tasks = Annotated[int | None, _TASKS]
BatchOut = Annotated[Path, typer.Option("--out", help="Where runs and results go.", metavar="DIR")]
_ENGINE = typer.Option("--engine", help="Processes on this machine, or tasks of a Ray cluster.")
Engine = Annotated[Literal["local", "ray"], _ENGINE]
_ADDRESS = typer.Option("--address", help="Of the Ray cluster; without it Ray starts on this machine.", metavar="A")
Address = Annotated[str | None, _ADDRESS]
Timeout = Annotated[float, typer.Option("--timeout", help="Seconds before a run is killed.", metavar="S", min=1)]
_WHERE = typer.Option("--where", help="List only these runs, as in 'status == \"accepted\"'.", metavar="CONDITION")
Where = Annotated[str | None, _WHERE]
Reports = Annotated[bool, typer.Option("--reports", help="Write the report of each run, too.")]
Unsafe = Annotated[bool, typer.Option("--unsafe-no-sandbox", help="Run generated code without isolation.")]

Jitter = Annotated[float, typer.Option("--jitter", help="Metres along x and y.", min=0, max=0.5)]
Yaw = Annotated[float, typer.Option("--yaw", help="Degrees about the vertical.", min=0, max=180)]
Mass = Annotated[float, typer.Option("--mass", help="Share of each object's mass.", min=0, max=0.99)]
Friction = Annotated[float, typer.Option("--friction", help="Share of its friction.", min=0, max=0.99)]
Light = Annotated[bool, typer.Option("--light", help="Vary where the light is, and how bright.")]
Texture = Annotated[bool, typer.Option("--texture", help="Vary the table's pattern and colours.")]
_DISTRACTORS = typer.Option("--distractors", help="Objects of the library to put about.", metavar="N", min=0, max=50)
Distractors = Annotated[int, _DISTRACTORS]

Episodes = Annotated[int, typer.Option("--episodes", help="How many are wanted.", metavar="N", min=1, max=1_000_000)]
_CAMERAS = "Whose pictures: photo, front, wrist, or none; front,wrist for lerobot, else none by default."
Cameras = Annotated[str | None, typer.Option("--camera", help=_CAMERAS, metavar="NAME,NAME")]
_OUT = "The folder; <run>-instances beside the run, for other robots <run>-robots."
InstancesOut = Annotated[Path | None, typer.Option("--out", help=_OUT, metavar="DIR")]
_ROBOTS = "An arm instead of the run's: ur5e, panda or the path of an MJCF or URDF file. Repeatable."
OtherRobots = Annotated[list[str] | None, typer.Option("--robot", help=_ROBOTS, metavar="NAME")]
_HANDS = "A hand instead of the run's: suction, franka_hand or robotiq_2f85. Repeatable."
OtherHands = Annotated[list[str] | None, typer.Option("--hand", help=_HANDS, metavar="NAME")]
Demonstrations = Annotated[
    int, typer.Option("--demonstrations", help="That the learned policy has.", metavar="N", min=1, max=10_000)
]
Trials = Annotated[
    int, typer.Option("--trials", help="Of the expert at each miss of its hand.", metavar="N", min=1, max=10_000)
]
RolloutSeed = Annotated[
    int | None, typer.Option("--seed", help="Of the rollout in the film; the first one by default.", metavar="N")
]
DemosOut = Annotated[
    Path | None, typer.Option("--out", help="The data set; <run>-demos beside the run.", metavar="DIR")
]
InstanceSeed = Annotated[
    int | None, typer.Option("--seed", help="Of the task instance; the first one by default.", metavar="N")
]
OfScene = Annotated[
    str | None, typer.Option("--of", help="Only those whose scene has this in its path.", metavar="TEXT")
]


def build_variation_from_options(
    jitter: float, yaw: float, mass: float, friction: float, light: bool, texture: bool, distractors: int
) -> "Variation":
    """The variation of these options; ``yaw`` is in degrees."""
    from grs_agents.sim.variation.types import Variation

    return Variation(
        jitter=jitter,
        yaw=math.radians(yaw),
        mass=mass,
        friction=friction,
        light=light,
        texture=texture,
        distractors=distractors,
    )


def load_effective_config(
    file: Path | None, settings: list[str] | None, seed: int | None = None, unsafe: bool = False
) -> "EffectiveConfig":
    """The configuration of these options; ``--seed N`` is ``--set seed=N``."""
    from grs_agents.base.config.load import load_config

    return load_config(file, [*(settings or []), *([] if seed is None else [f"seed={seed}"])], unsafe=unsafe)


def add_model_setting(settings: list[str] | None, models: list[str] | None) -> list[str]:
    """The settings plus ``--model``: ``--model NAME`` is ``--set models.default=NAME``."""
    return [*(settings or []), *([f"models.default={json.dumps(models)}"] if models else [])]


def add_robot_settings(settings: list[str], robot: str | None, hand: str | None) -> list[str]:
    """The settings plus ``robot`` of ``--robot`` and ``hand`` of ``--hand``."""
    named = (("robot", robot), ("hand", hand))
    return [*settings, *(f"{key}={json.dumps(value)}" for key, value in named if value is not None)]


def add_camera_settings(settings: list[str], camera: str | None, depth_scale: float | None) -> list[str]:
    """The settings plus ``camera.intrinsics`` of ``--camera`` and ``camera.depth_scale`` of ``--depth-scale``."""
    stated = [] if camera is None else [f"camera.intrinsics={json.dumps(camera)}"]
    return [*settings, *stated, *([] if depth_scale is None else [f"camera.depth_scale={depth_scale!r}"])]


def find_unnamed_scene(resumed: Path | None, cassette: str | None) -> Path:
    """The scene of a resumed or recorded run, for a command line without a scene.

    Raises:
        InputError: there is none, or a file would choose a photo of this machine.
    """
    if resumed is not None:
        from grs_agents.runs.run_opening import find_recorded_scene

        return find_recorded_scene(resumed)
    if cassette is not None:
        from grs_agents.agents.recorded import read_cassette
        from grs_agents.base import content

        # The file may be foreign: it must not choose which photo of this machine is opened.
        name, samples = read_cassette(cassette).scene, content.sample_scenes()
        if name not in samples:
            listing = ", ".join(samples)
            message = f"the cassette {cassette} is of the scene {name[:200]!r}, which is no sample ({listing})"
            raise InputError(message, "name its scene: grs run SCENE --cassette FILE")
        return samples[name]
    remedy = "name one, such as groceries; --cassette FILE and --resume --out DIR have their own"
    raise InputError("grs run needs a scene", remedy)


def build_recording_settings(record: Path | None, cassette: str | None) -> list[str]:
    """The settings of ``--record`` and ``--cassette``: a recorded run is repeated with its own settings."""
    from grs_agents.agents.recorded import read_cassette
    from grs_agents.runs.recording import select_cassette_settings

    values: dict[str, object] = {}
    if cassette is not None:
        values = select_cassette_settings(read_cassette(cassette).settings)
        values["cassette"] = str(Path(cassette).resolve()) if Path(cassette).exists() else cassette
    if record is not None:  # models may be called, then the user chooses them
        values = {key: value for key, value in values.items() if not key.startswith("models.")}
        values["record"] = str(record.resolve())
    return [f"{key}={json.dumps(value)}" for key, value in values.items()]


def check_graph_is_scene(chosen: "EffectiveConfig") -> None:
    """Refuse any graph but ``scene``, the only graph that comprehends a photo alone."""
    if chosen.sources.get("graph") == "--set" and chosen.config.graph != "scene":
        remedy = "leave graph out, or use grs run"
        raise ConfigError(f"grs scene runs the graph scene, not {chosen.config.graph!r}", remedy)


def check_episode_options(episode: str | None, suite: Path | None, of_runs: Mapping[str, bool]) -> None:
    """Refuse ``--suite`` without ``--episode``, and with it the options given in ``of_runs``, which episodes lack."""
    if episode is None and suite is not None:
        raise InputError("--suite is for an episode of its evaluation", "name the episode with --episode")
    given = [option for option, present in of_runs.items() if present]
    if episode is not None and given:
        raise InputError(f"{given[0]} is for runs, not for an episode of an evaluation", "leave it out")


_MAX_SUMMARY = 1000
"""Characters of a verb's first sentence in the help, more than any has: Typer cuts longer text."""


def _set_verbosity(name: Literal["quiet", "verbose"]) -> Callable[[bool], None]:
    def set_if_given(given: bool) -> None:
        if given:
            VERBOSITY.set(name)

    return set_if_given


def _declare_verbosity_options(
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print results and errors alone.", callback=_set_verbosity("quiet"))
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            help="Print each event, and the traceback of an error.",
            callback=_set_verbosity("verbose"),
        ),
    ] = False,
) -> None:
    """Only its options are used."""


class VerbGroup(TyperGroup):
    """Verbs grouped by ``rich_help_panel``, each with --quiet and --verbose besides its own options."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        app = typer.Typer(add_completion=False)
        app.command()(_declare_verbosity_options)
        options = get_command(app).params
        for option in options:
            option.expose_value = False
        for command in self.commands.values():
            command.params = [*command.params, *options]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the full first sentence of each verb under the title of its group."""
        verbs = [command for command in self.commands.values() if isinstance(command, TyperCommand | TyperGroup)]
        widest = max(len(verb.name or "") for verb in verbs)
        for title in dict.fromkeys(verb.rich_help_panel for verb in verbs):
            rows = [
                (verb.name, verb.get_short_help_str(_MAX_SUMMARY)) for verb in verbs if verb.rich_help_panel == title
            ]
            with formatter.section(title or "Commands"):
                formatter.write_dl([((name or "").ljust(widest), text) for name, text in rows])
