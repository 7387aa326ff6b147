"""This module recognises gestures in a stream of scans or readings."""

from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.errors import ReadingError, SkinMismatchError
from eskin.live.classifier import build_classifier
from eskin.live.decision import (
    Decision,
    DecisionFilter,
    Detection,
    DirectionTracker,
    build_detection,
    find_central_taxel,
)
from eskin.live.model_config import DecisionConfig
from eskin.live.model_file import MODELS, Model, load_model
from eskin.recording import Recording
from eskin.robot import Robot
from eskin.skin import MountedSkin, Skin, mount_skin
from eskin.touch import (
    Calibration,
    LinkPoseCache,
    Reading,
    Scan,
    Touch,
    TouchPipeline,
    TouchState,
)


@final
class Recognizer:
    """A recogniser finds gestures in a stream of scans or readings, without torch.

    It is stateful: every reading of every touch is encoded once; the logits equal those
    of the whole window computed offline.

    With a model that does not use the pose (`GraphConfig.posed`), only the positions
    and directions of detections depend on the pose.

    Attributes:
        model: weights and their card.
        mounted: the skin on its robot.
        state: the latest reading with its contacts and touches; None before the first.
        classifier: what gives the touches their logits.
        logits: logits of each sequence at the latest reading, by its key (see
            `TouchClassifier`).
        probabilities: calibrated probabilities of the model's vocabulary for each open
            touch at the latest reading, by its id; what is reported of a touch that
            closes may rest on others (`TouchClassifier.closing_probabilities`).
    """

    def __init__(
        self,
        model: Model,
        mounted: MountedSkin,
        calibration: Calibration | None,
        decision: DecisionConfig | None = None,
    ) -> None:
        """Start before the first scan.

        Args:
            model: weights and their card.
            mounted: the skin on its robot.
            calibration: calibration of the skin; None accepts only readings, no scans.
            decision: thresholds and times; None takes the model's.

        Raises:
            SkinMismatchError: the skin is on no robot, or does not measure what the
                model needs.
            ModelError: the weights do not fit the model's card, or no installed package
                registers its recogniser.
        """
        if isinstance(mounted, Skin):
            raise SkinMismatchError(
                f"a Skin is given ('{mounted.name}'), which lies on no robot; allowed "
                "is a MountedSkin; give eskin.MountedSkin(skin, robot), or call "
                "eskin.Recognizer.load(model, skin)"
            )
        card = model.card
        skin = mounted.skin
        if card.kind == "shear" and not skin.has_shear:
            raise SkinMismatchError(
                f"model needs shear, skin '{skin.name}' measures only pressure; "
                "allowed is a skin with a patch of kind shear; use a model for "
                "pressure alone"
            )
        self.model = model
        self.mounted = mounted
        self.has_calibration = calibration is not None
        # Never used: without a calibration, scans are refused.
        calibration = calibration or Calibration.uniform(skin.count, 4095, 100.0)
        poses = LinkPoseCache(mounted, card.graph.posed)
        self.pipeline = TouchPipeline(mounted, calibration, card.pipeline, poses)
        self.classifier = build_classifier(model, self.pipeline)
        self.decision_filter = DecisionFilter(
            card.vocabulary,
            decision or card.decision,
            change_ends=not skin.calibrated,
        )
        self.directions = DirectionTracker(
            poses if poses.use_kinematics else LinkPoseCache(mounted),
            self.decision_filter.config.min_travel,
        )
        self.state: TouchState | None = None
        self.logits: dict[int, Float[np.ndarray, "class"]] = {}
        self.probabilities: dict[int, Float[np.ndarray, "class"]] = {}

    @classmethod
    def load(
        cls,
        model: Model | str | Path,
        skin: str | Path | Skin | None = None,
        robot: str | Path | Robot | None = None,
        calibration: Calibration | None = None,
        decision: DecisionConfig | None = None,
        *,
        recording: Recording | None = None,
    ) -> "Recognizer":
        """Create a recogniser from a model, and a skin or a recording of one.

        Args:
            model: a model, the name of one that comes with eskin, or the path of a
                model file.
            skin: a preset's name, a skin's folder, or a skin; None for that of the
                recording, or the one that a model which comes with eskin was trained
                on.
            robot: a preset's name, a URDF, or a robot; None for that of the recording,
                or the skin's own.
            calibration: calibration of the skin; None for that of the recording;
                without either only readings are accepted, no scans.
            decision: thresholds and times; None takes the model's.
            recording: recording whose scans are recognised: it gives the skin, robot
                and calibration that are not given.

        Raises:
            SkinMismatchError: the skin is not known.
        """
        if recording is not None:
            skin = recording.skin if skin is None else skin
            robot = recording.load_robot() if robot is None else robot
            calibration = calibration or recording.calibration
        if skin is None and not isinstance(model, Model):
            skin = MODELS.get(str(model))
        if skin is None:
            what = "a model" if isinstance(model, Model) else f"model {model}"
            raise SkinMismatchError(
                f"{what} is given without a skin; allowed is none only for the names "
                f"{', '.join(MODELS)}; give a skin's name, folder or a Skin, or "
                "recording=RECORDING"
            )
        if not isinstance(model, Model):
            model = load_model(model)
        return cls(model, mount_skin(skin, robot), calibration, decision)

    def push(self, sample: Scan | Reading) -> list[Detection]:
        """Process the next scan or reading, and return new detections.

        Raises:
            ReadingError: it is of another skin or robot, or not later than the last
                one; the recogniser is unchanged then and accepts the next one.
        """
        self.check_input(sample)
        classifier = self.classifier
        if isinstance(sample, Scan):
            state = self.pipeline.push_scan(sample)
            classifier.classify_touches(state, self.pipeline.front_end.floor)
        else:
            state = self.pipeline.push_reading(sample)
            classifier.classify_touches(state, None)
        self.state = state
        self.logits = classifier.logits
        keys = {touch.id: classifier.get_key(touch.id) for touch in state.open}
        by_key = classifier.probabilities
        at_closing = classifier.closing_probabilities
        self.probabilities = {touch: by_key[key] for touch, key in keys.items()}
        self.directions.update(state)
        decisions = self.decision_filter.make_decisions(
            state.reading.stamp,
            state.open,
            state.closed,
            self.probabilities,
            {touch: at_closing[key] for touch, key in keys.items()},
        )
        detections = []
        if decisions:  # else the touches, which are costly to unpack, are not needed
            touches = (*state.touches, *state.closed_touches)
            detections = self.build_detections(decisions, touches)
        self.directions.forget(state.tracking.closed)
        return detections

    def finish(self) -> list[Detection]:
        """Close the touches still open, as at the end of a recording."""
        closed = self.pipeline.finish()
        detections = self.build_detections(self.decision_filter.close(closed), closed)
        self.directions.forget(closed)
        self.probabilities = {}
        return detections

    def build_detections(
        self, decisions: Sequence[Decision], touches: Sequence[Touch]
    ) -> list[Detection]:
        """Return the detections that report decisions at the latest reading."""
        if self.state is None:
            return []
        stamp = self.state.reading.stamp
        by_id = {touch.id: touch for touch in touches}
        return [
            build_detection(
                decision,
                touch := by_id[decision.touch],
                stamp,
                self.directions.compute_direction(touch.id),
                self.directions.find_heading(touch.id, touch.contact.n_world),
                find_central_taxel(touch.contact, self.mounted.skin),
            )
            for decision in decisions
        ]

    def check_input(self, sample: Scan | Reading) -> None:
        """Refuse a scan without calibration, or a reading without the shear needed."""
        if isinstance(sample, Scan) and not self.has_calibration:
            raise ReadingError(
                f"scan at {sample.stamp} ns, but there is no calibration; allowed are "
                "readings; give the recogniser the calibration of the skin"
            )
        if self.model.card.kind == "shear" and sample.shear is None:
            raise ReadingError(
                f"reading at {sample.stamp} ns has no shear, which the model needs; "
                "allowed are readings with shear; use a model for pressure alone"
            )
