"""The atlases in which an environment looks views up, one for each scene."""

from pathlib import Path

from labeling.core.errors import UsageError
from sbm_gym.atlas.scene_atlas import AtlasKey, SceneAtlas, finished_folders, folder_name, scene_digest
from sbm_gym.detection.simulated import SimulatedDetectorConfig
from sbm_gym.env.simulation import SimulationConfig
from sbm_gym.env.view_detectors import SIMULATED, is_simulated
from sbm_gym.scenes.compiled import Scene


class Atlases:
    """Opens the atlas of each scene when it is first needed, and keeps it open."""

    def __init__(self, folder: Path | None, config: SimulationConfig, detector: str | SimulatedDetectorConfig) -> None:
        """Opens nothing yet.

        Args:
            folder: of ``python -m sbm_gym.build_atlas``; None if nothing is looked up.
            config: settings of the environment.
            detector: its detector.
        """
        self._folder, self._config = folder, config
        # Atlases hold no detections of the simulated detector: it detects in the views that were looked up.
        self._detector = SIMULATED if is_simulated(detector) else str(detector)
        self._digest: str | None = None
        self._open: dict[str, SceneAtlas] = {}

    def held(self, scenes: tuple[str, ...]) -> tuple[str, ...]:
        """The scenes with a finished atlas; all given scenes if none has one or if nothing is looked up."""
        finished = set() if self._folder is None else finished_folders(self._folder)
        return tuple(scene for scene in scenes if folder_name(scene) in finished) or scenes

    def of_scene(self, scene: Scene) -> SceneAtlas | None:
        """The atlas of a scene, None if nothing is looked up.

        Raises:
            AtlasError: if there is none that fits, saying why.
            UsageError: if scenes of this kind cannot have one.
        """
        if self._folder is None:
            return None
        if scene.name not in self._open:
            self._open[scene.name] = SceneAtlas(self._folder, self.key(scene))
        return self._open[scene.name]

    def key(self, scene: Scene) -> AtlasKey:
        """The key of a scene's atlas.

        Raises:
            UsageError: if scenes of this kind cannot have one.
        """
        if scene.world.stage is not None:
            raise UsageError(f"scene {scene.name!r} is arranged anew for every episode: no atlas can hold its views")
        simulated = self._detector == SIMULATED
        if self._digest is None:
            from labeling.detectors.registry import detector_digest

            self._digest = "" if simulated else detector_digest(self._detector)
        config = self._config
        return AtlasKey(
            scene=scene.name,
            scene_digest=scene_digest(scene.world),
            detector=self._detector,
            detector_digest=self._digest,
            image_size=config.image_size,
            detector_size=config.image_size if simulated else config.detector_size,
            camera_height_m=config.robot.body.camera_height_m,
            tilt_rad=config.robot.rest_tilt_rad,
        )
