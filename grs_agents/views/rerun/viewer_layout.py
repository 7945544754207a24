"""Layout of the viewer: an overview and a tab for each stage of a run, or two runs side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun.blueprint as rrb

from grs_agents.base import Vec3
from grs_agents.views.rerun import state_machine_view
from grs_agents.views.rerun.recording import Paths
from grs_agents.views.rerun.waiting import placeholder_path


def build_run_blueprint(nodes: tuple[str, ...]) -> rrb.Blueprint:
    """Layout of a run; ``nodes`` are the nodes of its graph, to which the graph view is fitted."""
    views = _Views(nodes)
    stages = (views.overview_tab(), views.scene_tab(), views.programs_tab(), views.tests_and_fixes_tab())
    tabs = (*stages, views.rollouts_tab(), views.model_calls_tab())
    return _make_blueprint(rrb.Tabs(*tabs, active_tab=0))


def build_comparison_blueprint(runs: Sequence[tuple[str, str, tuple[str, ...]]]) -> rrb.Blueprint:
    """Layout of runs side by side; each is its name, path prefix, and nodes."""
    columns = [_Views(nodes, prefix).comparison_column(name) for name, prefix, nodes in runs]
    return _make_blueprint(rrb.Horizontal(*columns))


def build_episode_blueprint() -> rrb.Blueprint:
    """Layout of a single episode of an evaluation: the rollout in 3D, beside it its figures."""
    return _make_blueprint(_Views(()).episode_view())


def _make_blueprint(content: rrb.Container) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        # Opens at the latest moment, where every pane shows a result; at the first moment most show a placeholder.
        rrb.TimePanel(state="collapsed", timeline="replay", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
    )


@dataclass(frozen=True)
class _Views:
    """Views of a run whose entities are below ``prefix``."""

    nodes: tuple[str, ...]
    prefix: str = ""

    def overview_tab(self) -> rrb.Vertical:
        """The rollout in 3D; beside it photo and documents, below it the timeline of nodes."""
        scenes = rrb.Tabs(self._photo_view(), self._twin_view(), self._state_graph_view())
        texts = rrb.Tabs(*self._document_views("TASK SIMULATION DECISION AUDIT"))
        beside = rrb.Vertical(scenes, texts, row_shares=[1, 1])
        above = rrb.Horizontal(self._rollout_3d_view(), beside, column_shares=[5, 3])
        return rrb.Vertical(above, self._node_timeline_view(), row_shares=[6, 1], name="Overview")

    def scene_tab(self) -> rrb.Vertical:
        depth = self._camera_view("Depth", Paths.DEPTH, placeholder_path(Paths.DEPTH))
        above = rrb.Horizontal(self._photo_view(), self._twin_view(), depth)
        coverage = rrb.Spatial2DView(origin=self._prefixed_path(Paths.COVERAGE), name="Coverage")
        beside = rrb.Tabs(self._document_view("OBJECTS"), coverage)
        scene, camera = self._prefixed_path(Paths.SCENE), self._prefixed_path(Paths.CAMERA)
        scene_in_3d = rrb.Spatial3DView(
            origin=scene,
            contents=[f"{scene}/**", *(f"- {camera}/{part}/**" for part in ("masks", "boxes", "depth", "twin"))],
            name="Scene in 3D",
            eye_controls=_make_eye_controls((-0.15, -0.5, 0.6), (0.5, 0.0, 0.0)),
            line_grid=False,
        )
        below = rrb.Horizontal(scene_in_3d, beside, column_shares=[3, 2])
        return rrb.Vertical(above, below, row_shares=[4, 5], name="1 Scene")

    def programs_tab(self) -> rrb.Vertical:
        shown = rrb.Horizontal(*self._document_views("TASK SIMULATION TESTS"), column_shares=[2, 3, 3])
        return rrb.Vertical(shown, name="2 Task and programs")

    def tests_and_fixes_tab(self) -> rrb.Vertical:
        texts = (self._document_view("REPORT"), self._document_view("DECISION"), self._diff_log_view())
        above = rrb.Horizontal(*texts, column_shares=[3, 2, 3])
        charts = self._metric_chart_tabs("Tests passed")
        below = rrb.Horizontal(self._node_timeline_view(), charts, column_shares=[3, 2])
        return rrb.Vertical(above, below, row_shares=[3, 1], name="3 Tests and fixes")

    def rollouts_tab(self) -> rrb.Horizontal:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["LogLevel", "Body"])
        events = rrb.TextLogView(origin=self._prefixed_path(Paths.LOG), name="Events", columns=columns)
        beside = rrb.Vertical(self._document_view("AUDIT"), self._metric_chart_tabs(), events, row_shares=[3, 2, 3])
        return rrb.Horizontal(self._rollout_3d_view(), beside, column_shares=[3, 2], name="4 Rollouts and audit")

    def model_calls_tab(self) -> rrb.Horizontal:
        picture = rrb.Spatial2DView(origin=self._prefixed_path(Paths.IMAGE), name="Latest picture of a prompt")
        tokens = rrb.TimeSeriesView(origin=self._prefixed_path(f"{Paths.METRICS}/tokens"), name="Tokens")
        beside = rrb.Vertical(picture, tokens, row_shares=[3, 2])
        return rrb.Horizontal(*self._document_views("PROMPT REPLY"), beside, column_shares=[3, 3, 2], name="Models")

    def episode_view(self) -> rrb.Horizontal:
        """A single rollout beside its document."""
        return rrb.Horizontal(self._rollout_3d_view(), self._document_view("TASK"), column_shares=[5, 2])

    def comparison_column(self, name: str) -> rrb.Vertical:
        """A run of a comparison."""
        top = rrb.Tabs(self._state_graph_view(name), *self._document_views("TASK DECISION AUDIT"))
        pictures = (self._rollout_3d_view(), self._photo_view(), self._twin_view())
        before, after = self._document_views("SIMULATION TESTS"), self._document_views("REPORT PROMPT REPLY")
        texts = (*before, self._diff_log_view(), *after)
        shown = rrb.Tabs(*pictures, *texts)
        return rrb.Vertical(top, shown, self._node_timeline_view(), row_shares=[3, 5, 1.4], name=name)

    def _prefixed_path(self, path: str) -> str:
        return f"{self.prefix}{path}"

    def _document_view(self, key: str) -> rrb.TextDocumentView:
        title = "Test report" if key == "REPORT" else key.capitalize()
        return rrb.TextDocumentView(origin=self._prefixed_path(getattr(Paths, key)), name=title)

    def _document_views(self, names: str) -> list[rrb.TextDocumentView]:
        return [self._document_view(name) for name in names.split()]

    def _diff_log_view(self) -> rrb.TextLogView:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
        return rrb.TextLogView(origin=self._prefixed_path(Paths.DIFF), name="What changed", columns=columns)

    def _node_timeline_view(self) -> rrb.StateTimelineView:
        return rrb.StateTimelineView(origin=self._prefixed_path(Paths.NODE), name="Nodes over time")

    def _state_graph_view(self, name: str = "State machine") -> rrb.GraphView:
        spots = state_machine_view.node_positions(self.nodes).values()
        xs, ys = [spot[0] for spot in spots], [spot[1] for spot in spots]
        width = [min(xs, default=0) - 75, max(xs, default=0) + 75]
        height = [min(ys, default=0) - 30, max(ys, default=0) + 30]
        bounds = rrb.VisualBounds2D(x_range=width, y_range=height)
        return rrb.GraphView(
            origin=self._prefixed_path(Paths.MACHINE),
            name=name,
            visual_bounds=bounds,
            force_link=rrb.archetypes.ForceLink(enabled=False),
            force_many_body=rrb.archetypes.ForceManyBody(enabled=False),
            force_position=rrb.archetypes.ForcePosition(enabled=True, strength=1.0),
            force_collision_radius=rrb.archetypes.ForceCollisionRadius(enabled=False),
            force_center=rrb.archetypes.ForceCenter(enabled=False),
        )

    def _photo_view(self) -> rrb.Spatial2DView:
        shown = (Paths.PHOTO, placeholder_path(Paths.PHOTO), f"{Paths.CAMERA}/masks", f"{Paths.CAMERA}/boxes")
        return self._camera_view("Photo", *shown)

    def _twin_view(self) -> rrb.Spatial2DView:
        """The assets from the photo's camera, over the twin as MuJoCo rendered it."""
        shapes = (f"{Paths.TWIN}/**", f"{Paths.SURROUNDINGS}/**")
        return self._camera_view("Twin, same camera", Paths.TWIN_PICTURE, placeholder_path(Paths.TWIN_PICTURE), *shapes)

    def _camera_view(self, name: str, *paths: str) -> rrb.Spatial2DView:
        """The entities ``paths``, from the photo's camera."""
        origin = self._prefixed_path(Paths.CAMERA)
        return rrb.Spatial2DView(origin=origin, contents=[self._prefixed_path(path) for path in paths], name=name)

    def _rollout_3d_view(self) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            origin=self._prefixed_path(Paths.WORLD),
            contents=f"{self._prefixed_path(Paths.WORLD)}/**",
            name="Rollout",
            eye_controls=_make_eye_controls((1.2, -0.85, 0.68), (0.42, 0.0, 0.14)),
            line_grid=False,
        )

    def _metric_chart_tabs(self, first: str = "Reward") -> rrb.Tabs:
        axis, metrics = rrb.ScalarAxis(range=(-0.05, 1.1), zoom_lock=True), self._prefixed_path(Paths.METRICS)
        reward = rrb.TimeSeriesView(origin=f"{metrics}/reward", name="Reward", axis_y=axis)
        named = (("tests", "Tests passed"), ("tokens", "Tokens"), ("seconds", "Seconds"))
        others = (rrb.TimeSeriesView(origin=f"{metrics}/{key}", name=name) for key, name in named)
        return rrb.Tabs(reward, *others, active_tab=first)


def _make_eye_controls(position: Vec3, target: Vec3) -> rrb.archetypes.EyeControls3D:
    return rrb.archetypes.EyeControls3D(position=position, look_target=target, eye_up=(0, 0, 1))
