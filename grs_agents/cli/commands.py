"""The verbs of ``grs``. Each imports its implementation when called, to keep ``grs --help`` fast."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from grs_agents.base import content
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.cli.assets import assets_app
from grs_agents.cli.completion import complete_experiment, complete_graph, complete_run_folder, complete_scene
from grs_agents.cli.options import (
    Address,
    BatchOut,
    Camera,
    Cameras,
    Cassette,
    ConfigFile,
    Demonstrations,
    DemosOut,
    DepthScale,
    Distractors,
    Edits,
    Engine,
    Episodes,
    Friction,
    Hand,
    InstanceSeed,
    InstancesOut,
    Jitter,
    Json,
    Light,
    Mass,
    Models,
    OfScene,
    Otel,
    OtherHands,
    OtherRobots,
    Out,
    Record,
    Reports,
    Resume,
    Robot,
    RolloutSeed,
    Seed,
    Settings,
    Tasks,
    Texture,
    Timeout,
    Trials,
    Unsafe,
    VerbGroup,
    View,
    Where,
    Workers,
    Yaw,
    add_camera_settings,
    add_model_setting,
    add_robot_settings,
    build_recording_settings,
    build_variation_from_options,
    check_episode_options,
    check_graph_is_scene,
    find_unnamed_scene,
    load_effective_config,
)

app = typer.Typer(
    name="grs",
    cls=VerbGroup,
    help="From a photo with depth to a validated MuJoCo robot task.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
SCENE = typer.Argument(
    help="A folder (photo, depth or point cloud, camera.json), bop:ROOT/SPLIT/SCENE/IMAGE, .npz or photo; "
    "or a sample scene by its name, such as groceries.",
    autocompletion=complete_scene,
)
TaskFolder = Annotated[
    Path, typer.Argument(help="An accepted run, or a folder of grs instances.", autocompletion=complete_run_folder)
]
Scene = Annotated[Path, SCENE]


def resolve_run_argument(folder: Path) -> Path:
    """Resolve ``latest`` to a run folder."""
    from grs_agents.cli.runs import resolve_run_folder

    return resolve_run_folder(folder)


RunFolder = Annotated[
    Path,
    typer.Argument(
        help="A run folder, or latest: of those below runs/.",
        callback=resolve_run_argument,
        autocompletion=complete_run_folder,
    ),
]
_PORTABLE = "For MuJoCo 3.3 and dm_control too: suction by an adhesion actuator, no sleep."
_WARP = "For MuJoCo Warp: portable, with a sparse Jacobian."
_FOLDER = "A new or empty folder, or an earlier export; beside the run by default."
_EPISODE = "Of an evaluation: a name of motions/ without .npz; with --suite."
Episode = Annotated[str | None, typer.Option("--episode", help=_EPISODE, metavar="NAME")]
EvaluatedSuite = Annotated[
    Path | None, typer.Option("--suite", help="The suite of the evaluation, for --episode.", metavar="DIR")
]
RunStatus = Literal["running", "accepted", "rejected", "failed", "interrupted", "waiting"]
_POLICY = "oracle, random, lerobot:PATH, openpi:ws://HOST:PORT or package.module:Class."
_HUB = "Upload the data set to the Hugging Face Hub; one that is there already, too."
_LATENCY = "Simulated seconds that the robot waits for each reply."
_PERTURB = "Draw these, each by itself and together: camera, light, table, pose, distractors, mass, friction, words."
_SEEDS = "How many task instances to solve; audit.seeds by default."
Seeds = Annotated[int | None, typer.Option("--seeds", help=_SEEDS, min=1, max=100)]
_PAGE = "The file, - for the page on standard output; report.html in the run folder by default."
_TASK = "The task definition that it must keep to, as a run writes it."
_SCENE = (
    "The photo that it must keep to: a run folder, a scene.json, or what grs run takes, which is then comprehended."
)
_REPLY = "The reply; without it the question is printed, and asked on a terminal."
_ZIP = "The zip file, - for standard output; beside the run folder by default."
_SCENES = "Scenes, folders of scenes, .npz files, bop:ROOT/SPLIT, sample scenes, or globs of these in quotes."
_CONTENT = "Your own graphs, tools, prompts, assets, policies and models; their code is executed."


def print_version(requested: bool) -> None:
    """Print the version and exit, for ``--version``."""
    if requested:
        from grs_agents.base.version import __version__

        print_escaped(__version__)
        raise typer.Exit


@app.callback()
def apply_global_options(
    content_folder: Annotated[Path | None, typer.Option("--content", help=_CONTENT)] = None,
    version: Annotated[bool, typer.Option("--version", "-V", callback=print_version, is_eager=True)] = False,
) -> None:
    """From a photo with depth to a validated MuJoCo robot task."""
    if content_folder is not None:
        content.add_overlay_folder(content_folder)


@app.command(rich_help_panel="Make")
def run(
    scene: Annotated[Path | None, SCENE] = None,
    config: ConfigFile = None,
    settings: Settings = None,
    models: Models = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    robot: Robot = None,
    hand: Hand = None,
    seed: Seed = None,
    out: Out = None,
    resume: Resume = False,
    edits: Edits = None,
    json: Json = False,
    unsafe: Unsafe = False,
    record: Record = None,
    cassette: Cassette = None,
    view: View = False,
    otel: Otel = False,
) -> None:
    """Make a validated task of a photo with depth. Exit status: 0 accepted, 1 rejected, 2 bad input, 3 our error."""
    from grs_agents.cli.run import run_graph

    settings = [*build_recording_settings(record, cassette), *add_model_setting(settings, models)]
    settings = add_robot_settings(add_camera_settings(settings, camera, depth_scale), robot, hand)
    chosen = load_effective_config(config, settings, seed, unsafe)
    named = scene or find_unnamed_scene(out if resume else None, cassette)
    sys.exit(run_graph("run", named, chosen, out, resume, json, view, otel, resume and scene is None, edits))


@app.command(rich_help_panel="Make")
def scene(
    scene: Scene,
    config: ConfigFile = None,
    settings: Settings = None,
    models: Models = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    robot: Robot = None,
    hand: Hand = None,
    seed: Seed = None,
    out: Out = None,
    edits: Edits = None,
    json: Json = False,
) -> None:
    """Comprehend a photo alone: its objects, their boxes and assets."""
    from grs_agents.cli.run import run_graph

    settings = add_camera_settings(add_model_setting(settings, models), camera, depth_scale)
    settings = add_robot_settings(settings, robot, hand)
    check_graph_is_scene(load_effective_config(config, settings, seed))
    chosen = load_effective_config(config, [*settings, "graph=scene"], seed)
    sys.exit(run_graph("scene", scene, chosen, out, False, json, edits=edits))


@app.command(rich_help_panel="Make")
def edit(
    scene: Scene,
    config: ConfigFile = None,
    settings: Settings = None,
    models: Models = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    robot: Robot = None,
    hand: Hand = None,
    seed: Seed = None,
    out: Out = None,
    edits: Edits = None,
    port: Annotated[
        int, typer.Option("--port", help="Of the page on 127.0.0.1; 0 for a free one.", metavar="N", min=0, max=65535)
    ] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the address of the page.")] = False,
) -> None:
    """Correct the scene of a photo or run on a page."""
    from grs_agents.views.edit_page.guard import require_viser

    require_viser()
    from grs_agents.cli.edit import edit_scene

    settings = add_camera_settings(add_model_setting(settings, models), camera, depth_scale)
    settings = add_robot_settings(settings, robot, hand)
    perception = load_effective_config(config, [*settings, "graph=scene"], seed)
    chosen = load_effective_config(config, settings, seed)
    sys.exit(edit_scene(scene, perception, chosen, out, edits, port, not no_browser))


@app.command(rich_help_panel="Make")
def check(
    simulation: Annotated[
        Path, typer.Argument(help="A simulation program: a Python file with a Task subclass; or a run folder.")
    ],
    tests: Annotated[Path | None, typer.Option("--tests", help="Its unittest file.", metavar="TESTS.py")] = None,
    task: Annotated[Path | None, typer.Option("--task", help=_TASK, metavar="TASK.json")] = None,
    scene: Annotated[Path | None, typer.Option("--scene", help=_SCENE, metavar="SCENE")] = None,
    seeds: Seeds = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="A new folder for the task, if accepted.", metavar="DIR")
    ] = None,
    config: ConfigFile = None,
    settings: Settings = None,
    json: Json = False,
    unsafe: Unsafe = False,
) -> None:
    """Test and audit a simulation program of your own.

    It is checked as a run checks its own, without models but the judge. Exit status as for run.
    """
    from grs_agents.cli.check import check_program

    extra = [] if seeds is None else [f"audit.seeds={seeds}"]
    chosen = load_effective_config(config, [*(settings or []), *extra], unsafe=unsafe)
    sys.exit(check_program(simulation, tests, task, scene, chosen, out, json))


@app.command(rich_help_panel="Look")
def verify(run: RunFolder, json: Json = False, unsafe: Unsafe = False) -> None:
    """Verify that a run is unchanged and its audit repeats, or a suite.

    Exit status: 0 holds, 1 differs.
    """
    if (run / "suite.json").is_file():
        from grs_agents.cli.suites import verify_suite_folder

        sys.exit(verify_suite_folder(run, json))
    from grs_agents.cli.verify import verify_run_folder

    sys.exit(verify_run_folder(run, load_effective_config(None, None, unsafe=unsafe).config, json))


@app.command(rich_help_panel="Make")
def batch(
    scenes: Annotated[list[str] | None, typer.Argument(help=_SCENES)] = None,
    tasks: Tasks = None,
    config: ConfigFile = None,
    settings: Settings = None,
    models: Models = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    seed: Seed = None,
    out: BatchOut = Path("runs/batch"),
    engine: Engine = "local",
    address: Address = None,
    workers: Workers = 2,
    timeout: Timeout = 600,
    where: Where = None,
    reports: Reports = False,
    json: Json = False,
) -> None:
    """Run many scenes, each in its own process.

    Without SCENES those of --out are listed again. The same command goes on where it was interrupted. Exit status 1: a
    run has no verdict, or a task is wanting.
    """
    from grs_agents.cli.batch import list_batch, run_batch_and_print_rows

    if not scenes:
        sys.exit(list_batch(out, where, json))
    settings = add_camera_settings(add_model_setting(settings, models), camera, depth_scale)
    limits = {"workers": workers, "timeout": timeout, "engine": engine, "address": address}
    sys.exit(run_batch_and_print_rows(scenes, out, tasks, seed, config, settings, where, reports, json, **limits))


@app.command("runs", rich_help_panel="Look")
def list_run_folders(
    folder: Annotated[Path, typer.Argument(help="What the run folders lie in.")] = Path("runs"),
    status: Annotated[
        RunStatus | None, typer.Option("--status", help="Only those that ended so, or wait or run still.")
    ] = None,
    scene: OfScene = None,
    page: Annotated[bool, typer.Option("--page", help="Write them as a page of cards instead.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="The page; runs.html in the folder by default.", metavar="FILE")
    ] = None,
    without_films: Annotated[
        bool, typer.Option("--no-films", help="A page without films, each 1.2 CPU seconds.")
    ] = False,
    json: Json = False,
) -> None:
    """List runs, the newest first.

    The page has photo, twin, film, sentence and verdict of each run, filters, and shows two runs side by side.
    """
    from grs_agents.cli.runs import list_runs, write_runs_index

    if page or out is not None:
        write_runs_index(folder, status, scene, out, not without_films, json)
    else:
        list_runs(folder, status, scene, json)


@app.command(rich_help_panel="Look")
def compare(
    run: RunFolder,
    other: Annotated[Path, typer.Argument(help="Another run folder.", autocompletion=complete_run_folder)],
    json: Json = False,
) -> None:
    """Say what differs between two runs, or two evaluations.

    Compared are outcome, settings, task, counts, seconds and programs; of evaluations the success in paired episodes.
    """
    if (run / "episodes.jsonl").is_file():
        from grs_agents.cli.suites import print_paired_comparison

        sys.exit(print_paired_comparison(run, other, json))
    from grs_agents.cli.runs import compare_runs

    compare_runs(run, other, json)


@app.command(rich_help_panel="Make")
def approve(
    run: RunFolder,
    reply: Annotated[str | None, typer.Option("--reply", help=_REPLY, metavar="TEXT")] = None,
    config: ConfigFile = None,
    settings: Settings = None,
    models: Models = None,
    json: Json = False,
    unsafe: Unsafe = False,
) -> None:
    """Answer the question that a waiting run asks, and let it go on. Exit status as for run; 4: it waits."""
    from grs_agents.cli.run import approve_run

    chosen = load_effective_config(config, add_model_setting(settings, models), unsafe=unsafe)
    sys.exit(approve_run(run, reply, chosen, json))


@app.command(rich_help_panel="Look")
def show(
    run: RunFolder,
    step: Annotated[int | None, typer.Option("--step", help="Print one step in full.", metavar="N")] = None,
    failed: Annotated[bool, typer.Option("--failed", help="Print the last step that went wrong in full.")] = False,
    json: Json = False,
) -> None:
    """Show the steps of a run as a tree, or one step in full.

    A step in full has its exact prompts, replies, diffs and tracebacks.
    """
    from grs_agents.cli.show import show_run, show_step

    if step is None and not failed:
        show_run(run, json)
    else:
        show_step(run, step, json)


@app.command(rich_help_panel="Look")
def replay(
    run: RunFolder,
    beside: Annotated[Path | None, typer.Argument(help="Another run to show beside it.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Open the viewer in a browser.")] = False,
    window: Annotated[bool, typer.Option("--mujoco", help="Play a rollout in MuJoCo's window instead.")] = False,
    seed: RolloutSeed = None,
    episode: Episode = None,
    suite: EvaluatedSuite = None,
    json: Json = False,
) -> None:
    """Open the recording of a run in the rerun viewer, on 127.0.0.1.

    Two runs stand side by side. Of an evaluation --episode names one of its episodes.
    """
    from grs_agents.cli.show import open_run_viewer, play_in_window

    of_runs = {"a second run": beside is not None, "--mujoco": window, "--seed": seed is not None}
    check_episode_options(episode, suite, of_runs)
    if episode is not None:
        from grs_agents.cli.suites import open_episode_viewer

        sys.exit(open_episode_viewer(run, suite, episode, web, json))
    sys.exit(play_in_window(run, seed) if window else open_run_viewer(run, beside, web, json))


@app.command(rich_help_panel="Look")
def report(
    run: RunFolder,
    out: Annotated[Path | None, typer.Option("--out", help=_PAGE, metavar="FILE")] = None,
    seed: RolloutSeed = None,
    large: Annotated[bool, typer.Option("--hd", help="A film of 1280x720 instead of 640x480.")] = False,
    otel: Otel = False,
    episode: Episode = None,
    suite: EvaluatedSuite = None,
    json: Json = False,
) -> None:
    """Write a run as a page, a film of the robot, or the recording.

    The file needs nothing else. Its ending says which: .html for a page, .webp, .mp4 or .gif for a film, .rrd for the
    recording. Of an evaluation --episode names one of its episodes, for a film or a recording.
    """
    from grs_agents.cli.run_outputs import send_otel_spans, write_run_as_file

    check_episode_options(episode, suite, {"--otel": otel, "--seed": seed is not None})
    if episode is not None:
        from grs_agents.cli.suites import write_episode_as_file

        write_episode_as_file(run, suite, episode, out, large, json)
    elif otel:
        send_otel_spans(run, json)
    else:
        write_run_as_file(run, out, seed, large, json)


@app.command(rich_help_panel="Use")
def instances(
    run: RunFolder,
    seeds: Annotated[str, typer.Option("--seeds", help="Which to make, END not among them.", metavar="FIRST:END")],
    jitter: Jitter = 0.0,
    yaw: Yaw = 0.0,
    mass: Mass = 0.0,
    friction: Friction = 0.0,
    light: Light = False,
    texture: Texture = False,
    distractors: Distractors = 0,
    robot: OtherRobots = None,
    hand: OtherHands = None,
    out: InstancesOut = None,
    workers: Workers = 2,
    json: Json = False,
) -> None:
    """Make more instances of a run, or the same for other robots.

    Each is a variation of an instance of the run, and the expert has solved it. With --robot or --hand a table says
    which robots solve the task.
    """
    from grs_agents.cli.instances import write_instances, write_instances_of_robots

    variation = build_variation_from_options(jitter, yaw, mass, friction, light, texture, distractors)
    if robot or hand:
        sys.exit(write_instances_of_robots(run, seeds, variation, robot or [], hand or [], out, workers, json))
    sys.exit(write_instances(run, seeds, variation, out, workers, json))


@app.command(rich_help_panel="Use")
def demos(
    run: TaskFolder,
    episodes: Episodes = 200,
    kind: Annotated[str, typer.Option("--format", help="lerobot, robomimic or minari.")] = "lerobot",
    cameras: Cameras = None,
    size: Annotated[str, typer.Option("--size", help="Of the pictures.", metavar="ROWSxCOLUMNS")] = "224x224",
    seed: Annotated[int, typer.Option("--seed", help="Of the variations.", metavar="N", min=0, max=2**32 - 1)] = 0,
    jitter: Jitter = 0.03,
    yaw: Yaw = 30.0,
    mass: Mass = 0.0,
    friction: Friction = 0.0,
    light: Light = False,
    texture: Texture = False,
    distractors: Distractors = 0,
    noise: Annotated[float, typer.Option("--noise", help="Of the tip in replays, metres.", min=0, max=0.05)] = 0.008,
    replays: Annotated[int, typer.Option("--replays", help="With noise, of each episode.", metavar="N", min=0)] = 0,
    control: Annotated[str, typer.Option("--control", help="joint_position or ee_delta.")] = "joint_position",
    out: DemosOut = None,
    hub: Annotated[str, typer.Option("--push-to-hub", help=_HUB, metavar="USER/NAME")] = "",
    private: Annotated[bool, typer.Option("--private", help="On the Hub for its owner alone.")] = False,
    workers: Workers = 2,
    json: Json = False,
) -> None:
    """Make a data set of the expert's demonstrations.

    Each is replayed through the environment at 25 Hz. They begin in the instances there are, then in variations of
    them. Begun again after an interruption, the same command goes on. Exit status 1: fewer episodes came about.
    """
    from grs_agents.cli.demos import parse_cameras, parse_demo_control, parse_size, write_demonstrations
    from grs_agents.tasks.demos.production import DemoOrder

    variation = build_variation_from_options(jitter, yaw, mass, friction, light, texture, distractors)
    order = DemoOrder(
        episodes=episodes,
        noise=noise,
        control=parse_demo_control(control),
        replays=replays,
        seed=seed,
        variation=variation,
        cameras=parse_cameras(cameras, kind),
        size=parse_size(size),
    )
    sys.exit(write_demonstrations(run, order, kind, out, hub, private, workers, json))


@app.command(rich_help_panel="Use")
def grade(
    run: RunFolder,
    episodes: Annotated[int, typer.Option("--episodes", help="Of each policy.", metavar="N", min=1, max=10_000)] = 30,
    demonstrations: Demonstrations = 60,
    trials: Trials = 12,
    seed: Seed = None,
    workers: Workers = 2,
    json: Json = False,
) -> None:
    """Measure how hard an accepted task is.

    The grade is one number, told with the moves, clutter, tolerance and successes that it is made of.
    """
    from grs_agents.cli.grade import print_grade
    from grs_agents.tasks.grading.trials import GradeOrder

    order = GradeOrder(episodes=episodes, demonstrations=demonstrations, trials=trials, seed=seed or 0)
    sys.exit(print_grade(run, order, workers, json))


@app.command(rich_help_panel="Use")
def suite(
    folder: Annotated[Path, typer.Argument(help="A new folder for the suite.")],
    runs: Annotated[
        list[Path],
        typer.Argument(help="Accepted runs, batches, or folders of grs instances.", autocompletion=complete_run_folder),
    ],
    name: Annotated[str | None, typer.Option("--name", help="Of the suite; the folder's by default.")] = None,
    instances: Annotated[int, typer.Option("--instances", help="Of each task.", metavar="N", min=1, max=10_000)] = 10,
    jitter: Jitter = 0.03,
    yaw: Yaw = 30.0,
    mass: Mass = 0.0,
    friction: Friction = 0.0,
    light: Light = False,
    texture: Texture = False,
    distractors: Distractors = 0,
    graded: Annotated[bool, typer.Option("--grade", help="Measure each task's difficulty: minutes a task.")] = False,
    workers: Workers = 2,
    json: Json = False,
) -> None:
    """Make a benchmark of accepted tasks.

    Each task gets varied instances that the expert has solved. Begun again after an interruption, the command goes on.
    """
    from grs_agents.cli.suites import write_suite

    variation = build_variation_from_options(jitter, yaw, mass, friction, light, texture, distractors)
    sys.exit(write_suite(folder, runs, name, instances, variation, graded, workers, json))


@app.command(rich_help_panel="Use")
def evaluate(
    suite: Annotated[Path, typer.Argument(help="A folder that grs suite wrote.")],
    policy: Annotated[str, typer.Option("--policy", help=_POLICY, metavar="POLICY")],
    layout: Annotated[str, typer.Option("--layout", help="grs, lerobot, droid or a TOML file.")] = "grs",
    episodes: Annotated[int, typer.Option("--episodes", help="Of each task.", metavar="N", min=1, max=100_000)] = 10,
    words: Annotated[str, typer.Option("--words", help="default, specific, vague, or several.")] = "default",
    task: Annotated[
        list[str] | None, typer.Option("--task", help="Only this task; repeatable.", metavar="NAME")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of random actions.", metavar="N", min=0, max=2**31 - 1)] = 0,
    timeout: Annotated[float, typer.Option("--timeout", help="Of each reply, seconds.", metavar="S")] = 30.0,
    latency: Annotated[str, typer.Option("--latency", help=_LATENCY, metavar="S|measured")] = "0",
    perturb: Annotated[str, typer.Option("--perturb", help=_PERTURB, metavar="FACTORS")] = "",
    out: Annotated[Path | None, typer.Option("--out", help="A folder for the results.", metavar="DIR")] = None,
    engine: Engine = "local",
    address: Address = None,
    workers: Workers = 2,
    json: Json = False,
) -> None:
    """Measure how well a policy solves the tasks of a suite.

    A hung or broken policy is an outcome of its episode. Begun again after an interruption, the command goes on.
    """
    from grs_agents.cli.suites import evaluate_policy

    settings = {
        "episodes": episodes,
        "words": tuple(filter(None, words.split(","))),
        "tasks": tuple(task or ()),
        "seed": seed,
        "timeout": timeout,
        "latency": latency,
        "perturb": tuple(dict.fromkeys(filter(None, perturb.split(",")))),
    }
    sys.exit(evaluate_policy(suite, policy, layout, out, workers, engine, address, settings, json))


@app.command(rich_help_panel="Look")
def share(
    run: RunFolder,
    out: Annotated[Path | None, typer.Option("--out", help=_ZIP, metavar="FILE.zip")] = None,
    json: Json = False,
) -> None:
    """Pack a run into one zip file without keys and home folders.

    The recording and the report are in it.
    """
    from grs_agents.cli.run_outputs import share_run_as_zip

    share_run_as_zip(run, out, json)


@app.command(rich_help_panel="Use")
def export(
    run: TaskFolder,
    to: Annotated[Literal["mjcf"], typer.Option("--format", help="What to write.")] = "mjcf",
    portable: Annotated[bool, typer.Option("--portable", help=_PORTABLE)] = False,
    warp: Annotated[bool, typer.Option("--warp", help=_WARP)] = False,
    seed: InstanceSeed = None,
    out: Annotated[Path | None, typer.Option("--out", help=_FOLDER, metavar="DIR")] = None,
    json: Json = False,
) -> None:
    """Write an accepted task as a folder that opens in plain MuJoCo."""
    from grs_agents.cli.export import export_task

    assert to == "mjcf"  # the only format so far
    export_task(run, seed, portable, warp, out, json)


@app.command(rich_help_panel="Extend")
def graph(
    name: Annotated[str, typer.Argument(help="A graph's name; see grs list.", autocompletion=complete_graph)],
    json: Json = False,
) -> None:
    """Print a graph as a mermaid diagram."""
    from grs_agents.runs.graph_loading import compile_graph

    topology = compile_graph(name).get_graph()
    print_json(topology.to_json()) if json else print_escaped(topology.draw_mermaid())


@app.command("mcp", rich_help_panel="Extend")
def serve_tools(
    port: Annotated[
        int | None,
        typer.Option("--http", help="Over HTTP on 127.0.0.1 instead of stdio.", metavar="PORT", min=0, max=65535),
    ] = None,
    config: ConfigFile = None,
    settings: Settings = None,
    unsafe: Unsafe = False,
    json: Annotated[bool, typer.Option("--json", help="Print the tools with their schemas instead.")] = False,
) -> None:
    """Serve GRS to agents over the Model Context Protocol."""
    from grs_agents.serving.mcp_server import list_mcp_tools, serve_mcp

    chosen = load_effective_config(config, settings, unsafe=unsafe)
    print_json(list_mcp_tools(chosen)) if json else serve_mcp(chosen, port)


@app.command(rich_help_panel="Extend")
def doctor(json: Json = False) -> None:
    """Say what works on this machine, and how to get what does not."""
    from grs_agents.cli.doctor import diagnose_installation

    sys.exit(diagnose_installation(json))


@app.command("list", rich_help_panel="Extend")
def list_available_content(
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of one event of a run.")] = False,
    json: Json = False,
) -> None:
    """List graphs, tools, prompts, assets, evals, policies and models."""
    from grs_agents.base.trace.events import event_schema
    from grs_agents.cli.listing import list_content

    print_json(event_schema()) if schema else list_content(json)


@app.command("config", rich_help_panel="Extend")
def show_config(config: ConfigFile = None, settings: Settings = None, seed: Seed = None, json: Json = False) -> None:
    """Show the effective configuration with the source of each value."""
    from grs_agents.cli.listing import list_config

    list_config(load_effective_config(config, settings, seed), json)


app.add_typer(assets_app, rich_help_panel="Extend")
_PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "allow_interspersed_args": False}


@app.command("eval", context_settings=_PASS_ON, rich_help_panel="Extend")
def run_named_experiment(
    context: typer.Context,
    name: Annotated[
        str, typer.Argument(help="An experiment's name; see grs list.", autocompletion=complete_experiment)
    ],
) -> None:
    """Run an experiment, such as routing.

    Words after the name are passed on to it, --help included: grs eval NAME --help.
    """
    from grs_agents.runs.experiments import load_experiment

    sys.exit(load_experiment(name).main(context.args))
