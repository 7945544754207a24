"""The configuration's types: frozen, every key known, every bound stated.

Configuration, sandbox and simulation share ``Limits``, the bounds on the cost of a sandbox call.
"""

import json
import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal, cast

from pydantic import Field, JsonValue, ValidationInfo, field_validator, model_validator

from grs_agents.base import Frozen


@dataclass(frozen=True)
class Portable:
    """Marks a setting that a run folder or a cassette may bring along. All others come from the user of this machine:
    files, code, endpoints, models, and shares of the machine. Its texts must match ``pattern`` whole."""

    pattern: str = r"[A-Za-z0-9_-]{1,64}"


class Limits(Frozen):
    """Bounds on the cost of a call; each bound has an outcome of its own.

    A call is all tests of a file, or all seeds of an instantiation. The sandbox keeps the first six, whatever the code
    in it does. The simulation keeps the last three: they end a program that asks for too much with an error that says
    so, long before the others would.
    """

    # from the moment the worker takes the request, kept by the host
    wall_seconds: float = Field(default=60, gt=0, le=3600)
    # processor time of the worker process, kept by the kernel (whole seconds, rounded up)
    cpu_seconds: float = Field(default=50, gt=0, le=3600)
    memory_mib: int = Field(default=1024, ge=64, le=65536)  # address space on top of that of a fresh worker
    scratch_mib: int = Field(default=64, ge=1, le=4096)  # everything in the worker's scratch folder
    # everything the worker writes: standard output, progress and result together
    output_mib: int = Field(default=8, ge=1, le=256)
    threads: int = Field(default=64, ge=1, le=1024)  # of the worker process, all together
    simulated_steps: int = Field(default=500_000, ge=1, le=1_000_000_000)  # time steps of all simulated worlds together
    objects: int = Field(default=200, ge=1, le=200)  # on the table at once
    # of all meshes of the objects on the table at once
    mesh_vertices: int = Field(default=200_000, ge=1, le=100_000_000)


ROLES = (
    *("default", "group", "describe", "match", "task", "simulation", "tests"),
    *("route", "fix_code", "fix_tests", "fix_task", "judge", "rival"),
)
"""The agent roles a model may be named for; ``default`` serves every role that has none of its own."""
ROLE_ALIASES = {"router": "route", "describer": "describe", "matcher": "match", "task_author": "task"}


class ModelChoice(Frozen):
    """A chat model, and how it is made and asked."""

    # `offline`; `provider:name` (a provider that `init_chat_model` knows, azure, bedrock or google); a class of the
    # user's (`package.module:Class`); or an entry point in the group `grs_agents.models`
    model: str
    base_url: str | None = None  # another endpoint that speaks the provider's protocol
    key_variable: str | None = None  # the NAME of the environment variable that holds the key, never the key
    temperature: float | None = Field(default=None, ge=0, le=2)  # passed on if given
    # seconds for a reply, from the first request to its last byte, including retries and the waits between them
    timeout: float = Field(default=300.0, gt=0)
    max_tokens: int | None = Field(default=None, gt=0)  # the longest reply
    concurrency: int = Field(default=8, ge=1, le=64)  # calls under way at once
    # ask for JSON by a schema (`with_structured_output`) until the provider refuses it; `off`: by the prompt alone
    structured: Literal["auto", "off"] = "auto"
    # send it pictures; `auto`: unless LangChain's profile of the model says that it reads none
    pictures: bool | Literal["auto"] = "auto"
    # requests that it is sent on average, and at once after a pause; no limit if None
    requests_per_second: float | None = Field(default=None, gt=0, le=1000)
    burst: int = Field(default=1, ge=1, le=1000)
    # further arguments of the class that is made
    arguments: dict[str, JsonValue] = Field(default_factory=dict[str, JsonValue])

    @field_validator("key_variable")
    @classmethod
    def _validate_key_variable(cls, value: str | None) -> str | None:
        if value is not None and not re.fullmatch(r"[A-Z_][A-Z0-9_]*", value):
            raise ValueError("this is no name of an environment variable (A-Z, 0-9, _); the key itself does not belong")
        return value

    @field_validator("base_url")
    @classmethod
    def _refuse_password_in_url(cls, value: str | None) -> str | None:
        host = (value or "").split("//", 1)[-1].split("/", 1)[0]
        if "@" in host:
            raise ValueError("a user or password in the URL would be recorded; give the key by key_variable")
        return value

    @field_validator("arguments")
    @classmethod
    def _refuse_keys_in_arguments(cls, value: dict[str, JsonValue]) -> dict[str, JsonValue]:
        secret = re.search(r'"([^"]*(key|token|secret|password|authorization))":', json.dumps(value), re.IGNORECASE)
        if secret:
            raise ValueError(f"{secret.group(1)} would be recorded; give the key by key_variable")
        return value


class ModelConfig(ModelChoice):
    """The chat model of a role, and its fallbacks."""

    # in this order; each inherits `temperature`, `timeout` and `max_tokens` from the first
    fallbacks: tuple[ModelChoice, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _spell_out_fallbacks(cls, values: Any) -> Any:
        """``model`` may be a list: the first, and its fallbacks, each a name or a table."""
        named = cast("dict[str, Any]", values) if isinstance(values, dict) else {}
        if not isinstance(named.get("model"), list) or not named["model"]:
            return cast(Any, values)
        first, *rest = cast("list[Any]", named["model"])
        shared = {key: named[key] for key in ("temperature", "timeout", "max_tokens") if key in named}
        fallbacks = [{**shared, **(choice if isinstance(choice, dict) else {"model": choice})} for choice in rest]
        return {**named, "model": first, "fallbacks": fallbacks}


class ToolsConfig(Frozen):
    """The tool file for each exchangeable job."""

    segment: str = "segment_rgbd"
    depth: str = "depth_given"
    match: str = "match_hybrid"
    shape: str = "shape_seen"


TableChoice = Literal["auto", "largest", "highest"] | Annotated[int, Field(ge=1, le=100)]
"""The table among the level planes of the photo: by a rule, or by its number in ``scene.json``."""


class CoverageConfig(Frozen):
    """Bounds on the share of the pixels above the table that objects own."""

    warn: float = Field(default=0.8, ge=0, le=1)  # below it the run warns first, and names unowned regions


class SceneConfig(Frozen):
    """Settings for reading a photo."""

    # `auto`; `largest`, the level plane with most pixels; `highest`; or the number of a plane of `frame.planes` in
    # `scene.json`
    table: TableChoice = "auto"
    # `auto`: a model that sees pictures is asked once which segments belong together, and what is no object; `off`
    group: Literal["auto", "off"] = "auto"
    # objects without a role in the task stand on the table too, as in the photo
    bystanders: bool = True
    coverage: CoverageConfig = CoverageConfig()


class ShapeConfig(Frozen):
    """Settings of a shape tool beside the view of an object."""

    model: str | None = Field(default=None, max_length=4096)  # folder of a model of the user's


class SegmentConfig(Frozen):
    """Settings of a segmentation tool beside the photo."""

    model: str | None = Field(default=None, max_length=4096)  # folder, or file, of a model of the user's
    device: str = Field(default="cpu", pattern=r"^[a-z]+(:\d+)?$")  # device to run on, as torch names it
    batch: int = Field(default=16, ge=1, le=1024)  # points that a model of masks is asked about at once
    # prompts of a detector, as a person would say them; the kinds of the library's everyday objects if empty
    prompts: Annotated[
        tuple[Annotated[str, Field(min_length=1, max_length=100)], ...], Portable(r"[^\x00-\x1f]{1,100}")
    ] = Field(default=(), max_length=200)


class DepthConfig(Frozen):
    """Settings of a depth tool for a photo without depth."""

    model: str | None = Field(default=None, max_length=4096)  # folder of a model of the user's
    # of the photo's width, in degrees, if neither `camera.json` nor the photo states its lens
    field_of_view: Annotated[float | None, Portable()] = Field(default=None, ge=5, le=150)


class CameraConfig(Frozen):
    """Statements of the user on the photo's camera, which prevail over the files of the scene."""

    # FX,FY,CX,CY[,WIDTH,HEIGHT] in pixels, or a sensor whose published field of view is taken
    intrinsics: Annotated[str | None, Portable(r"[A-Za-z0-9_.,+-]{1,200}")] = Field(default=None, max_length=200)
    # metres per unit of depth
    depth_scale: Annotated[float | None, Portable()] = Field(default=None, gt=0, le=1000)
    # whether colour and depth are rectified; decided by the planes of the depth if the lens is distorted
    rectified: Annotated[bool | None, Portable()] = None


class MatchConfig(Frozen):
    """Settings of a match tool beside the candidates, and the treatment of unmatched objects."""

    model: str | None = Field(default=None, max_length=4096)  # the folder of a model of the user's own (`match_clip`)
    # read text printed on objects; needs the extra `ocr` and is passed over without it
    ocr: Annotated[bool, Portable()] = True
    # the folder of an index of the library (`grs assets index`)
    index: str | None = Field(default=None, max_length=4096)
    # show a describer that sees as many segments as are legible on a numbered `sheet` at once, or `each` by itself
    describe: Annotated[Literal["each", "sheet"], Portable()] = "sheet"
    # replace an unmatched object by a proxy of its size and look; if false, it is left out
    proxies: Annotated[bool, Portable()] = True


class BackgroundConfig(Frozen):
    """Reconstruction of the table's surroundings for the simulation."""

    on: bool = False  # reconstruct it; needs the extra `background`
    # voxel edge of the signed distance field, metres; colliders have voxels of twice that
    voxel: float = Field(default=0.015, ge=0.005, le=0.1)


_Finite = Annotated[float, Field(allow_inf_nan=False)]


class OwnHandConfig(Frozen):
    """Fingers in the file of a user's arm, where they are not recognised."""

    # names of the joints that move the fingers; all others beyond the arm stand still
    joints: tuple[Annotated[str, Field(min_length=1, max_length=200)], ...] = Field(min_length=1, max_length=12)
    # positions of these joints, wide open and closed: radians, or metres of a slide
    open: tuple[_Finite, ...]
    closed: tuple[_Finite, ...]
    # position of the point between the ends of the fingers, in the frame of the body that carries them, metres; None:
    # measured
    tcp: tuple[_Finite, _Finite, _Finite] | None = None

    @model_validator(mode="after")
    def _validate_lengths(self) -> "OwnHandConfig":
        counts = len(self.open), len(self.closed)
        if counts != (len(self.joints),) * 2:
            raise ValueError(
                f"own_hand has {len(self.joints)} joints, {counts[0]} open and {counts[1]} closed positions"
            )
        return self


class PromptsConfig(Frozen):
    """The prompt file of each role."""

    group: str = "group"
    describe: str = "describe"
    match: str = "match"
    task: str = "task"
    simulation: str = "simulation"
    tests: str = "tests"
    route: str = "route"
    fix_code: str = "fix_code"
    fix_tests: str = "fix_tests"
    fix_task: str = "fix_task"
    judge: str = "judge"


class AuditConfig(Frozen):
    """Criteria for accepting a task."""

    seeds: Annotated[int, Portable()] = Field(default=3, ge=1, le=100)  # number of task instances to solve
    # the least strict score, and the least published reward, that the oracle must reach on each
    reward: Annotated[float, Portable()] = Field(default=0.99, gt=0, le=1)
    # model that compares the task's words with its goals: `offline`, another model, or null for that of the role
    # `judge`; by default a model other than the task author's, if there is one
    judge: Annotated[str | None, Portable(r"offline")] = None
    # `sentence`: words that nobody could judge are no fault, the task is accepted for the sentence of its goals;
    # `agree`: the judge must agree with the words
    words: Annotated[Literal["sentence", "agree"], Portable()] = "sentence"


class AuthorConfig(Frozen):
    """Budget of an author with tools before it hands in its program."""

    steps: int = Field(default=6, ge=0, le=100)  # calls of tools, in each visit of the graph `tool_author`


class BudgetConfig(Frozen):
    """Budget of a run for its models; a run that exhausts it ends as rejected, with its best task."""

    tokens: int | None = Field(default=None, gt=0)  # read and written together
    cost: float | None = Field(default=None, gt=0)  # US dollars, if the providers report it
    minutes: float | None = Field(default=None, gt=0)  # wall time of all its attempts


class Price(Frozen):
    """Price of a model, in US dollars per million tokens."""

    input: float = Field(ge=0, le=1e5)
    output: float = Field(ge=0, le=1e5)
    cached: float | None = Field(default=None, ge=0, le=1e5)  # of input read from a cache; that of other input if None


class Config(Frozen):
    """All settings of a run."""

    graph: Annotated[str, Portable()] = "grs"  # the topology to run, by its name in `graphs/`
    # policy that decides between fixing code and tests: `llm` (a model), `rules` (types), `hybrid` (rules, the model in
    # doubt), `vote` (the model, asked in both orders), `always_code`, a dotted path (`package.module:Policy`) or an
    # entry point in the group `grs_agents.policies`
    policy: Annotated[str, Portable()] = "llm"
    # the seed of everything random, the offline model's choices included
    seed: Annotated[int, Portable()] = Field(default=0, ge=0, lt=2**31)
    # the arm behind the table: `ur5e`, `panda`, `menagerie:NAME` or the path of an MJCF (`.xml`) or URDF file
    robot: Annotated[str, Portable()] = Field(default="ur5e", max_length=4096)
    # the hand at its flange: `suction`, `franka_hand`, `robotiq_2f85`, or `own`, of the robot's file, and then the
    # default; pushing takes a spatula in place of any
    hand: Annotated[str, Portable()] = Field(default="suction", max_length=100)
    # the hand in the robot's file, where it is not recognised
    own_hand: OwnHandConfig | None = None
    max_fixes: Annotated[int, Portable()] = Field(default=10, ge=0, le=1000)  # fixes of code, tests and task together
    # steps of the graph until a run of it counts as endless; by default 25 and 4 for each of the fixes
    recursion_limit: int | None = Field(default=None, ge=1, le=1_000_000)
    # show `route`, `fix_code` and `fix_task` a picture of how the robot's episode ended, and `judge` its start too;
    # their models must see
    end_picture: Annotated[bool, Portable()] = True
    # separation of generated code from the machine: `bubblewrap`, `landlock`, `sandbox-exec` (macOS), or `auto` for the
    # strongest that holds. `none` can only be asked for with `--unsafe-no-sandbox`
    sandbox: Literal["auto", "bubblewrap", "landlock", "sandbox-exec", "none"] = "auto"
    workers: int = Field(default=2, ge=1, le=64)  # sandbox calls that may run at once
    # repetitions of a request whose reply does not parse, with the error
    reply_retries: Annotated[int, Portable()] = Field(default=2, ge=0, le=20)
    models: dict[str, ModelConfig] = Field(default_factory=lambda: {"default": ModelConfig(model="offline")})
    tools: Annotated[ToolsConfig, Portable()] = ToolsConfig()
    scene: Annotated[SceneConfig, Portable()] = SceneConfig()
    segment: SegmentConfig = SegmentConfig()
    depth: DepthConfig = DepthConfig()
    camera: Annotated[CameraConfig, Portable()] = CameraConfig()
    match: MatchConfig = MatchConfig()
    shape: ShapeConfig = ShapeConfig()
    background: Annotated[BackgroundConfig, Portable()] = BackgroundConfig()
    prompts: Annotated[PromptsConfig, Portable()] = PromptsConfig()
    limits: Limits = Limits()
    audit: AuditConfig = AuditConfig()
    author: Annotated[AuthorConfig, Portable()] = AuthorConfig()
    budget: BudgetConfig = BudgetConfig()
    # of models whose provider reports no cost, by the model's name or a pattern such as `openai:*`
    prices: dict[str, Price] = Field(default_factory=dict[str, Price], max_length=1000)
    # `record`: file for every exchange with the models, written when the run ends. `cassette`: recorded run whose
    # replies are given instead of asking models (a file, or the name of a shipped run). With both, models are asked
    # only for missing replies
    record: str | None = Field(default=None, max_length=4096)
    cassette: str | None = Field(default=None, max_length=4096)

    def model_for_role(self, role: str) -> ModelConfig:
        """The model of ``role``.

        For the judge, ``audit.judge`` takes precedence. Without either, it is the first model that is not the task
        author's; the author's own if there is no other.
        """
        if role == "judge" and self.audit.judge is not None:
            return ModelConfig(model=self.audit.judge)
        if role == "judge" and role not in self.models:
            author = self.model_for_role("task")
            others = [spec for spec in self.models.values() if spec.model not in (author.model, "offline")]
            return others[0] if others and author.model != "offline" else author
        return self.models.get(role, self.models["default"])

    def price_of(self, model: str) -> Price | None:
        """The price of ``model``: by its name, else by the longest pattern that matches it; None if there is none."""
        patterns = [name for name in self.prices if name == model or fnmatchcase(model, name)]
        return self.prices[max(patterns, key=lambda name: (name == model, len(name)))] if patterns else None

    @field_validator("hand")
    @classmethod
    def _validate_hand(cls, hand: str, fields: ValidationInfo) -> str:
        if hand == "own" and fields.data.get("robot") in ("ur5e", "panda"):
            raise ValueError(f"{fields.data['robot']} has no hand of its own; use suction, franka_hand, robotiq_2f85")
        if hand in ("suction", "franka_hand", "robotiq_2f85", "own"):
            return hand
        raise ValueError(
            f"there is no hand {hand!r}; use suction, franka_hand, robotiq_2f85, or own, of the robot's own file"
        )

    @field_validator("robot")
    @classmethod
    def _validate_robot(cls, robot: str) -> str:
        if robot in ("ur5e", "panda") or robot.endswith((".xml", ".mjcf", ".urdf")):
            return robot
        raise ValueError(
            f"there is no arm {robot!r}; use ur5e, panda, menagerie:NAME or the path of an MJCF or URDF file (.xml, "
            ".mjcf, .urdf)"
        )
