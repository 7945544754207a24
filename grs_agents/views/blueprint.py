"""How the viewer lays a run out: state machine left, texts in the middle, pictures right, time below."""

import rerun.blueprint as rrb

from grs_agents.base import Vec3
from grs_agents.views import machine
from grs_agents.views.paths import Paths


def blueprint(nodes: tuple[str, ...]) -> rrb.Blueprint:
    """The default layout; ``nodes`` are those of the run's graph, which the graph view is fitted to."""
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_machine(nodes), _texts(), _pictures(), column_shares=[2.2, 2.4, 3]),
            rrb.Horizontal(
                rrb.StateTimelineView(origin=Paths.NODE, name="Nodes over time"),
                _metrics(),
                rrb.TextLogView(
                    origin=Paths.LOG,
                    name="Events",
                    columns=rrb.archetypes.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
                ),
                column_shares=[2.6, 2, 3],
            ),
            row_shares=[3, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline="replay", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
    )


def _machine(nodes: tuple[str, ...]) -> rrb.Vertical:
    spots = machine.places(nodes).values()
    xs, ys = [spot[0] for spot in spots], [spot[1] for spot in spots]
    bounds = rrb.VisualBounds2D(
        x_range=[min(xs, default=0) - 75, max(xs, default=0) + 75],
        y_range=[min(ys, default=0) - 30, max(ys, default=0) + 30],
    )
    graph = rrb.GraphView(
        origin=Paths.MACHINE,
        name="State machine",
        visual_bounds=bounds,
        force_link=rrb.archetypes.ForceLink(enabled=False),
        force_many_body=rrb.archetypes.ForceManyBody(enabled=False),
        force_position=rrb.archetypes.ForcePosition(enabled=True, strength=1.0),
        force_collision_radius=rrb.archetypes.ForceCollisionRadius(enabled=False),
        force_center=rrb.archetypes.ForceCenter(enabled=False),
    )
    return rrb.Vertical(graph, _verdicts(), row_shares=[3, 2])


def _verdicts() -> rrb.Tabs:
    return rrb.Tabs(
        rrb.TextDocumentView(origin=Paths.DECISION, name="Decision"),
        rrb.TextDocumentView(origin=Paths.TASK, name="Task"),
        rrb.TextDocumentView(origin=Paths.OBJECTS, name="Objects"),
        rrb.TextDocumentView(origin=Paths.AUDIT, name="Audit"),
    )


def _texts() -> rrb.Tabs:
    columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
    return rrb.Tabs(
        rrb.TextDocumentView(origin=Paths.SIMULATION, name="Code"),
        rrb.TextDocumentView(origin=Paths.TESTS, name="Tests"),
        rrb.TextLogView(origin=Paths.DIFF, name="Diff", columns=columns),
        rrb.TextDocumentView(origin=Paths.REPORT, name="Report"),
        rrb.TextDocumentView(origin=Paths.PROMPT, name="Prompt"),
        rrb.TextDocumentView(origin=Paths.REPLY, name="Reply"),
    )


def _pictures() -> rrb.Vertical:
    camera = Paths.CAMERA
    photo = [f"{camera}/rgb", f"{camera}/masks", f"{camera}/boxes"]
    scene = rrb.Tabs(
        rrb.Spatial2DView(origin=camera, contents=photo, name="Photo"),
        rrb.Spatial2DView(origin=camera, contents=[f"{camera}/depth"], name="Depth"),
        rrb.Spatial3DView(
            origin=Paths.SCENE,
            contents=[f"{Paths.SCENE}/**", f"- {camera}/masks", f"- {camera}/boxes", f"- {camera}/depth"],
            name="Scene in 3D",
            eye_controls=_eye((-0.15, -0.5, 0.6), (0.5, 0.0, 0.0)),
            line_grid=False,
        ),
        rrb.Spatial2DView(origin=Paths.IMAGE, name="Prompt picture"),
    )
    rollout = rrb.Spatial3DView(
        origin=Paths.WORLD,
        contents=f"{Paths.WORLD}/**",
        name="Rollout",
        eye_controls=_eye((1.05, -0.75, 0.6), (0.42, 0.0, 0.12)),
        line_grid=False,
    )
    return rrb.Vertical(scene, rollout, row_shares=[5, 6])


def _eye(position: Vec3, target: Vec3) -> rrb.archetypes.EyeControls3D:
    return rrb.archetypes.EyeControls3D(position=position, look_target=target, eye_up=(0, 0, 1))


def _metrics() -> rrb.Tabs:
    reward = rrb.ScalarAxis(range=(-0.05, 1.1), zoom_lock=True)
    return rrb.Tabs(
        rrb.TimeSeriesView(origin=f"{Paths.METRICS}/reward", name="Reward", axis_y=reward),
        rrb.TimeSeriesView(origin=f"{Paths.METRICS}/tests", name="Tests"),
        rrb.TimeSeriesView(origin=f"{Paths.METRICS}/tokens", name="Tokens"),
        rrb.TimeSeriesView(origin=f"{Paths.METRICS}/seconds", name="Seconds"),
    )
