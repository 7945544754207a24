"""How the viewer lays a run out: an overview to open with, then one tab for each stage; two runs side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun.blueprint as rrb

from grs_agents.base import Vec3
from grs_agents.views.rerun import state_machine
from grs_agents.views.rerun.recording import Paths


def blueprint(nodes: tuple[str, ...]) -> rrb.Blueprint:
    """The default layout of one run; ``nodes`` are those of its graph, which the graph view is fitted to."""
    views = _Views(nodes)
    tabs = (views.overview(), views.photo(), views.programs(), views.fixes(), views.rollouts(), views.models())
    return _blueprint(rrb.Tabs(*tabs, active_tab=0))


def comparison(runs: Sequence[tuple[str, str, tuple[str, ...]]]) -> rrb.Blueprint:
    """The layout of runs side by side; each is its name, the path that its entities lie below, and its nodes."""
    columns = [_Views(nodes, prefix).column(name) for name, prefix, nodes in runs]
    return _blueprint(rrb.Horizontal(*columns))


def _blueprint(content: rrb.Container) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        # At its latest moment every pane shows something; at the first one all are empty.
        rrb.TimePanel(state="collapsed", timeline="replay", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
    )


@dataclass(frozen=True)
class _Views:
    """The views of a run whose entities lie below ``prefix``."""

    nodes: tuple[str, ...]
    prefix: str = ""

    def overview(self) -> rrb.Vertical:
        verdicts = rrb.Tabs(*self._texts("DECISION TASK OBJECTS AUDIT"))
        texts = rrb.Tabs(*self._texts("SIMULATION TESTS"), self._diff(), *self._texts("REPORT PROMPT REPLY"))
        pictures = rrb.Vertical(
            rrb.Tabs(self._boxes(), self._twin(), self._space()), self._rollout(), row_shares=[5, 6]
        )
        return rrb.Vertical(
            rrb.Horizontal(
                rrb.Vertical(self._machine(), verdicts, row_shares=[3, 2]), texts, pictures, column_shares=[2.2, 2.4, 3]
            ),
            rrb.Horizontal(self._lane(), self._metrics(), self._events(), column_shares=[2.6, 2, 3]),
            row_shares=[3, 1],
            name="Overview",
        )

    def photo(self) -> rrb.Vertical:
        return rrb.Vertical(
            rrb.Horizontal(self._boxes(), self._depth(), self._twin()),
            rrb.Horizontal(self._space(), self._text("OBJECTS"), column_shares=[3, 2]),
            row_shares=[4, 5],
            name="1 Scene",
        )

    def programs(self) -> rrb.Vertical:
        shown = rrb.Horizontal(*self._texts("TASK SIMULATION TESTS"), column_shares=[2, 3, 3])
        return rrb.Vertical(shown, name="2 Task and programs")

    def fixes(self) -> rrb.Vertical:
        return rrb.Vertical(
            rrb.Horizontal(self._text("REPORT"), self._text("DECISION"), self._diff(), column_shares=[3, 2, 3]),
            rrb.Horizontal(self._lane(), self._metrics("Tests passed"), column_shares=[3, 2]),
            row_shares=[3, 1],
            name="3 Tests and fixes",
        )

    def rollouts(self) -> rrb.Horizontal:
        beside = rrb.Vertical(self._text("AUDIT"), self._metrics(), self._events(), row_shares=[3, 2, 3])
        return rrb.Horizontal(self._rollout(), beside, column_shares=[3, 2], name="4 Rollouts and audit")

    def models(self) -> rrb.Horizontal:
        picture = rrb.Spatial2DView(origin=self._at(Paths.IMAGE), name="Picture of the prompt")
        tokens = rrb.TimeSeriesView(origin=self._at(f"{Paths.METRICS}/tokens"), name="Tokens")
        beside = rrb.Vertical(picture, tokens, row_shares=[3, 2])
        return rrb.Horizontal(*self._texts("PROMPT REPLY"), beside, column_shares=[3, 3, 2], name="Models")

    def column(self, name: str) -> rrb.Vertical:
        """A run beside another."""
        top = rrb.Tabs(self._machine(name), *self._texts("TASK DECISION AUDIT"))
        pictures = (self._rollout(), self._boxes(), self._twin())
        texts = (*self._texts("SIMULATION TESTS"), self._diff(), *self._texts("REPORT PROMPT REPLY"))
        shown = rrb.Tabs(*pictures, *texts)
        return rrb.Vertical(top, shown, self._lane(), row_shares=[3, 5, 1.4], name=name)

    def _at(self, path: str) -> str:
        return f"{self.prefix}{path}"

    def _text(self, what: str) -> rrb.TextDocumentView:
        title = "Test report" if what == "REPORT" else what.capitalize()
        return rrb.TextDocumentView(origin=self._at(getattr(Paths, what)), name=title)

    def _texts(self, names: str) -> list[rrb.TextDocumentView]:
        return [self._text(name) for name in names.split()]

    def _diff(self) -> rrb.TextLogView:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
        return rrb.TextLogView(origin=self._at(Paths.DIFF), name="What changed", columns=columns)

    def _events(self) -> rrb.TextLogView:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["LogLevel", "Body"])
        return rrb.TextLogView(origin=self._at(Paths.LOG), name="Events", columns=columns)

    def _lane(self) -> rrb.StateTimelineView:
        return rrb.StateTimelineView(origin=self._at(Paths.NODE), name="Nodes over time")

    def _machine(self, name: str = "State machine") -> rrb.GraphView:
        spots = state_machine.node_positions(self.nodes).values()
        xs, ys = [spot[0] for spot in spots], [spot[1] for spot in spots]
        bounds = rrb.VisualBounds2D(
            x_range=[min(xs, default=0) - 75, max(xs, default=0) + 75],
            y_range=[min(ys, default=0) - 30, max(ys, default=0) + 30],
        )
        return rrb.GraphView(
            origin=self._at(Paths.MACHINE),
            name=name,
            visual_bounds=bounds,
            force_link=rrb.archetypes.ForceLink(enabled=False),
            force_many_body=rrb.archetypes.ForceManyBody(enabled=False),
            force_position=rrb.archetypes.ForcePosition(enabled=True, strength=1.0),
            force_collision_radius=rrb.archetypes.ForceCollisionRadius(enabled=False),
            force_center=rrb.archetypes.ForceCenter(enabled=False),
        )

    def _boxes(self) -> rrb.Spatial2DView:
        camera = self._at(Paths.CAMERA)
        return rrb.Spatial2DView(origin=camera, contents=[f"{camera}/{part}" for part in _PHOTO], name="Photo")

    def _depth(self) -> rrb.Spatial2DView:
        camera = self._at(Paths.CAMERA)
        return rrb.Spatial2DView(origin=camera, contents=[f"{camera}/depth"], name="Depth")

    def _twin(self) -> rrb.Spatial2DView:
        """The assets as the camera of the photo sees them."""
        contents = [f"{self._at(Paths.TWIN)}/**", f"{self._at(Paths.SURROUNDINGS)}/**"]
        return rrb.Spatial2DView(origin=self._at(Paths.CAMERA), contents=contents, name="Twin, same camera")

    def _space(self) -> rrb.Spatial3DView:
        scene, camera = self._at(Paths.SCENE), self._at(Paths.CAMERA)
        return rrb.Spatial3DView(
            origin=scene,
            contents=[f"{scene}/**", *(f"- {camera}/{part}" for part in ("masks", "boxes", "depth"))],
            name="Scene in 3D",
            eye_controls=_eye((-0.15, -0.5, 0.6), (0.5, 0.0, 0.0)),
            line_grid=False,
        )

    def _rollout(self) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            origin=self._at(Paths.WORLD),
            contents=f"{self._at(Paths.WORLD)}/**",
            name="Rollout",
            eye_controls=_eye((1.05, -0.75, 0.6), (0.42, 0.0, 0.12)),
            line_grid=False,
        )

    def _metrics(self, first: str = "Reward") -> rrb.Tabs:
        reward = rrb.ScalarAxis(range=(-0.05, 1.1), zoom_lock=True)
        metrics = self._at(Paths.METRICS)
        return rrb.Tabs(
            rrb.TimeSeriesView(origin=f"{metrics}/reward", name="Reward", axis_y=reward),
            rrb.TimeSeriesView(origin=f"{metrics}/tests", name="Tests passed"),
            rrb.TimeSeriesView(origin=f"{metrics}/tokens", name="Tokens"),
            rrb.TimeSeriesView(origin=f"{metrics}/seconds", name="Seconds"),
            active_tab=first,
        )


_PHOTO = ("rgb", "masks", "boxes")


def _eye(position: Vec3, target: Vec3) -> rrb.archetypes.EyeControls3D:
    return rrb.archetypes.EyeControls3D(position=position, look_target=target, eye_up=(0, 0, 1))
