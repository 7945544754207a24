"""The correction of a scene by a person, act by act.

The scene after each act is that which the node ``edit`` makes of the same edits: both call `apply_edit` and
`settle_edited_scene`.
"""

import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from grs_agents.agents.agent import Agents
from grs_agents.base.config.load import EffectiveConfig
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.foreign.files import path_exists
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.editing import (
    BEFORE,
    EditedScene,
    apply_edit,
    find_mask,
    find_overlaps,
    open_edited_scene,
    rank_assets,
    save_corrected_scene,
    settle_edited_scene,
)
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Services
from grs_agents.library.library import Library
from grs_agents.perception.edits import (
    FILE,
    Add,
    ChooseTable,
    CorrectMask,
    Edit,
    Pixel,
    SceneEdits,
    Split,
    inner_pixel,
    plane_number_at,
    read_edits,
)
from grs_agents.perception.picture_files import load_frame
from grs_agents.perception.reading.known_scene import is_known_scene
from grs_agents.perception.settling.groups import GroupSettler
from grs_agents.perception.types import Mask, RGBDFrame, SceneDescription, read_scene_description
from grs_agents.runs.execution import Outcome, Views, execute_run
from grs_agents.runs.hashes import write_hashes
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder, remove_run_folder, require_unused_folder
from grs_agents.runs.sandbox_setup import open_sandbox


class SceneEditor:
    """A scene that a person corrects; opened by `open_scene_editor`. Not to be called by two threads at a time."""

    def __init__(self, order: RunOrder, views: Views, photo: RGBDFrame, services: Services, edits: SceneEdits) -> None:
        """Correct the scene that ``services.folder`` holds before its edits."""
        self.folder, self.photo, self._order, self._views, self._services = (
            services.folder,
            photo,
            order,
            views,
            services,
        )
        self.undone: tuple[Edit, ...] = ()  # the next to redo last
        self._saved: SceneDescription | None = None
        self._settler = GroupSettler()
        self._kept: dict[tuple[Edit, ...], tuple[EditedScene, SceneDescription]] = {}  # undone, by all their edits
        self._rebuild(edits)

    @property
    def edits(self) -> tuple[Edit, ...]:
        """The edits in their order."""
        return self._edits.edits

    @property
    def scene(self) -> SceneDescription:
        """The corrected scene at rest."""
        return self._settled[-1]

    @property
    def library(self) -> Library:
        """The library with the scene's own assets."""
        return self._services.library

    @property
    def masks(self) -> Mapping[str, Mask]:
        """(H, W) pixels of each object, by its name."""
        return {edited.item.name: edited.mask for edited in self._steps[-1].objects}

    def place_of(self, name: str) -> Pixel:
        """A pixel that names an object in an edit; raises InputError if no object has the name."""
        masks = self.masks
        if name not in masks:
            raise InputError(f"no object is called {name!r}", f"name one of {', '.join(masks)}")
        place = inner_pixel(masks[name])
        if self._steps[-1].find(place).item.name == name:
            return place
        others = [mask for other, mask in masks.items() if other != name and mask.sum() <= masks[name].sum()]
        alone = masks[name].copy()
        for mask in others:
            alone &= ~mask
        return inner_pixel(alone) if alone.any() else place

    def apply(self, edit: Edit) -> None:
        """Add an edit; the scene settles anew.

        Raises:
            GrsError: the edit does not fit the scene, which is then unchanged.
        """
        self._kept.clear()  # its files may be written over
        self._append(edit)
        self.undone = ()

    def undo(self) -> None:
        """Drop the last edit. Raises InputError: there is none."""
        if not self.edits:
            raise InputError("there is no edit to undo", "correct the scene first")
        last = self.edits[-1]
        edits = SceneEdits(edits=self.edits[:-1])
        if isinstance(last, ChooseTable):
            self._perceive_anew(edits)
        else:
            self._kept[self.edits] = self._steps.pop(), self._settled.pop()
            self._edits = edits
        self.undone = (*self.undone, last)

    def redo(self) -> None:
        """Add the edit that was undone last again. Raises InputError: there is none."""
        if not self.undone:
            raise InputError("there is no edit to redo", "undo an edit first")
        self._append(self.undone[-1])
        self.undone = self.undone[:-1]

    def preview_part(self, edit: Add | Split | CorrectMask) -> Mask | None:
        """(H, W) pixels that an edit adds, parts, includes or excludes; None if nothing differs from the rim.

        Raises:
            InputError: the rectangle leaves the photo, or holds nothing of the object.
        """
        return find_mask(self._steps[-1], edit, self._services)

    def ranked_assets(self, place: Pixel) -> tuple[str, ...]:
        """The assets that look most like the object at a pixel, the best first, at most ten."""
        return rank_assets(self._steps[-1], place, self._services)

    def overlaps(self, place: Pixel, position: tuple[float, float], yaw: float) -> tuple[str, ...]:
        """The names of objects that the object at a pixel would stand in or half on, at a position (m) and turn (rad).

        `Move` is refused there.
        """
        step = self._steps[-1]
        return find_overlaps(step, step.find(place), position, yaw, self.library)

    def save(self) -> Path:
        """Write ``edits.json``, ``scene.json`` and the pictures into the folder. Returns: the file of the edits."""
        if self._saved is not self.scene:
            with EventLog(self.folder / "events.jsonl") as log:
                save_corrected_scene(self.scene, self._steps[-1], self._edits, self._services, log)
            record = read_record(self.folder)
            counts = {**record.counts, "objects": len(self.scene.objects)}
            record.model_copy(update={"edits": self.scene.edits, "counts": counts}).write(self.folder)
            write_hashes(self.folder)
            self._saved = self.scene
        return self.folder / FILE

    def _append(self, edit: Edit) -> None:
        try:
            edits = SceneEdits(edits=(*self.edits, edit))
        except ValidationError as error:
            raise InputError(f"{edit.act}: {error.errors(include_url=False)[0]['msg']}", "undo edits first") from error
        if isinstance(edit, ChooseTable):
            plane_number_at(self.photo, self._steps[0].table, edit.point)
            self._perceive_anew(edits)
            return
        if edits.edits in self._kept:
            step, settled = self._kept.pop(edits.edits)
        else:
            step = apply_edit(self._steps[-1], edit, self._services)
            settled = settle_edited_scene(step, self._services, self._settler)
        self._steps.append(step)
        self._settled.append(settled)
        self._edits = edits

    def _rebuild(self, edits: SceneEdits) -> None:
        """Apply the edits to the scene before them."""
        before = read_scene_description(self.folder / BEFORE)
        steps = [open_edited_scene(before, self.photo, self.folder)]
        for edit in edits.edits:
            steps.append(apply_edit(steps[-1], edit, self._services))
        settled = [before, *(settle_edited_scene(step, self._services, self._settler) for step in steps[1:])]
        self._kept.clear()
        self._steps, self._settled, self._edits = steps, settled, edits

    def _perceive_anew(self, edits: SceneEdits) -> None:
        """Perceive the photo with another table; the folder is written anew."""
        if is_known_scene(self._order.source):
            raise InputError(f"{self._order.source} is a scene whose table is chosen", "open the photo instead")
        self._saved = None
        try:
            _perceive(self._order, self._views, self.folder, edits)
            self._rebuild(edits)
        except GrsError:
            _perceive(self._order, self._views, self.folder, self._edits)
            self._rebuild(self._edits)  # their files are gone, too
            raise


def _perceive(order: RunOrder, views: Views, folder: Path | None, edits: SceneEdits) -> Outcome:
    """Run perception into a folder, whose content is removed first; of the edits it knows the choice of the table."""
    if folder is not None and folder.is_dir():
        remove_run_folder(folder, ())
    chosen = SceneEdits(edits=tuple(edit for edit in edits.edits if isinstance(edit, ChooseTable)))
    ended = execute_run(replace(order, out=folder, given={"edits": chosen}), views)
    if ended.problem is not None:
        raise ended.problem
    if ended.record.status != "accepted":
        raise KeyboardInterrupt(f"perception in {ended.folder} was interrupted")
    return ended


@contextmanager
def open_scene_editor(
    source: Path, folder: Path | None, config: EffectiveConfig, views: Views
) -> Generator[SceneEditor]:
    """Perceive a photo, or copy the scene of a run, into a new folder, and correct it there.

    Args:
        source: a photo, as `grs scene` takes it, or the folder of a run or scene, whose edits are kept.
        folder: new or empty; below ``runs`` if None.
        config: of perception; its graph is ``scene``.
        views: attached to the run of perception.

    Raises:
        GrsError: as `grs scene`.
    """
    edits = read_edits(source / FILE) if is_known_scene(source) and path_exists(source / FILE) else SceneEdits()
    order = RunOrder("scene", source, config)
    if folder is not None:
        require_unused_folder(folder)
    ended = _perceive(order, views, folder, edits)
    settings, state = config.config, ended.state
    photo = load_frame(ended.folder, state["camera"], state["scene_path"])
    with (
        tempfile.TemporaryDirectory() as scratch,
        EventLog(Path(scratch) / "events.jsonl") as log,  # of acts that may be undone
        open_sandbox(settings) as sandbox,
    ):
        services = Services(
            config=settings,
            log=log,
            agents=Agents.resume_from_log(settings, log, ended.folder),
            policy=load_policy(settings.policy),
            sandbox=sandbox,
            folder=ended.folder.resolve(),
        )
        yield SceneEditor(order, views, photo, services, edits)
