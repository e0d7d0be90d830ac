# SPDX-License-Identifier: Apache-2.0
"""The node `correct`: on request, the pose of the hand at which the next view equals the reference view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from arm_correction.corrector import Corrector
from arm_correction.frames import frames_of
from arm_correction.live import CorrectNodeConfig, driver_frame
from arm_correction.reference import load_reference, save_reference
from tof_core.errors import RefusedError, TransformError
from tof_core.live import Dwells
from tof_ros import messages, qos
from tof_ros.actions import quiet, serve
from tof_ros.colour import ColourFeed
from tof_ros.diagnostics import status
from tof_ros.managed import ManagedNode
from tof_ros.placing import Placing
from tof_ros.views import ViewFeed
from tof_scene.builtin import open_scene
from tof_scene.raycast import Raycaster
from tof_sensor.known import known_bias

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from arm_correction.correction import Correction
    from arm_correction.frames import Frames
    from tof_core.arrays import Float
    from tof_core.capture import RobotPose, View
    from tof_ros.actions import Progress

NAME = "correct"
OUTPUTS = {"pose": PoseWithCovarianceStamped, "delta": PoseStamped, "verdict": DiagnosticArray}
"""Topics under `correction/`, once per `~/propose`, with the stamp of the view; pose and delta only of what is accepted."""
TYPED = {"proposal": "CorrectionProposal"}
"""One a registration, with typed fields (toftwin_msgs), also of what is refused."""
ACTIONS = {"propose": "Propose"}
CONFIG = CorrectNodeConfig
LEVELS = {"accepted": DiagnosticStatus.OK, "partial": DiagnosticStatus.WARN, "refused": DiagnosticStatus.ERROR}


class CorrectNode(ManagedNode[CorrectNodeConfig]):
    """Proposes corrections (docs/nodes/correct.md). It moves nothing unless `live.connect` names the arm's topic."""

    threads = 2

    def __init__(self, **options: Any) -> None:
        """Nothing loaded yet."""
        super().__init__(NAME, "correction", CorrectNodeConfig, fixed=("live.", "align."), **options)
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self._proposal = self.typed("proposal", TYPED["proposal"])
        self._verdict = ""
        self._placing = Placing(self)
        self.service("capture_reference", self._capture, slow=True)
        self.service("propose", self._service, slow=True)
        serve(self, "propose", ACTIONS["propose"], self._answer)

    def load(self) -> None:
        """Read the scene and the reference, where they exist."""
        live, config = self.config.live, self.config
        self._scene = open_scene(live.scene) if live.scene else None
        caster = Raycaster(self._scene) if self._scene else None
        self._corrector = Corrector(config.correct, config.align, caster=caster, bias=known_bias(live.sensor))
        if live.reference and Path(live.reference).with_suffix(".json").exists():
            self._corrector.use(load_reference(live.reference))

    def start(self) -> None:
        """Hear `preproc` and TF."""
        live, scene = self.config.live, self._scene
        self._chain = self._placing.chain(live, scene.frame if scene else "", scene.placed_in if scene else None)
        self._dwells = Dwells(2)
        colour = ColourFeed(self, self._chain, live)
        self._feed = ViewFeed(self, self._chain, live.patience_s, lambda view: self._dwells.add(colour.beside(view)), self._placing.camera)
        self._arm = self.create_publisher(PoseStamped, live.connect, qos.OUTPUT) if live.connect else None
        self.at_stop.append(self._disarm)

    def _disarm(self) -> None:
        """Stop sending commands."""
        arm, self._arm = self._arm, None
        if arm is not None:
            self.destroy_publisher(arm)

    def unload(self) -> None:
        """Release scene and reference."""
        del self._corrector, self._scene

    def retune(self, config: CorrectNodeConfig) -> None:
        """Other limits hold from the next proposal on."""
        self._corrector.config = config.correct

    def reset(self) -> str:
        """Discard the dwells; the reference is kept."""
        self._dwells.clear()
        self._feed.reset()
        return "the dwells are discarded, the reference is kept"

    def _capture(self) -> str:
        """Store the last dwell as the reference."""
        reference = self._corrector.capture(self._dwells.all()[-1])
        path = self.config.live.reference
        return f"the reference is of {reference.stamp_ns}" + (f", kept in {save_reference(reference, path)}" if path else "")

    def _service(self) -> str:
        """The answer of the service; what is refused is its error."""
        message, proposals = self._propose(quiet)
        if not (chosen := proposals[0].correction).accepted:
            raise RefusedError(chosen.reason, where=chosen.by)
        return message

    def _answer(self, goal: Any, progress: Progress) -> Any:
        """The result of the action."""
        del goal
        from toftwin_msgs.action import Propose

        progress.total = 2
        message, proposals = self._propose(progress)
        return Propose.Result(success=proposals[0].correction.accepted, message=message, proposals=[p.message() for p in proposals])

    def _propose(self, progress: Callable[[str], None]) -> tuple[str, list[Proposed]]:
        """Register the last dwell, publish the correction, and send it to the arm if `live.connect` names a topic."""
        views, live = self._dwells.all(), self.config.live
        view = views[-1]
        age_s = (self.get_clock().now().nanoseconds - view.stamp_ns) * 1e-9
        frames = frames_of(self._chain, view.camera.frame_id, view.stamp_ns, live.hand_frame, live.frame)
        target = driver_frame(frames) if live.connect else ""
        progress("register")
        made = self._corrector.propose(views, frames, lambda: self._pose_now(view), age_s=age_s)
        progress("publish")  # what is cancelled by now publishes nothing and moves nothing
        proposals = [Proposed(c, view, frames) for c in made.values()]
        chosen = proposals[0].correction
        self._publish(proposals)
        self._verdict = f"{chosen.verdict}: {chosen.reason}"
        if not chosen.accepted:
            return chosen.reason, proposals
        mm, deg = chosen.step
        sent = f"; sent to {self._command(chosen.T_frame_hand, target)}" if live.connect else ""
        return f"{chosen.verdict}: {mm:.1f} mm and {deg:.2f} deg by {chosen.by}: {chosen.reason}{sent}", proposals

    def _command(self, T_frame_hand: Float, target: str) -> str:
        """Send the hand there; gives the arm's topic."""
        arm = self._arm  # the node's other thread may stop it meanwhile
        if arm is None:
            raise RefusedError("stopped meanwhile, nothing was sent", where="correction", todo="activate the node and ask again")
        arm.publish(messages.pose_stamped(T_frame_hand, messages.header(self.get_clock().now().nanoseconds, target)))
        return str(arm.topic_name)

    def _pose_now(self, view: View) -> RobotPose:
        """The robot's present pose by TF; without it nothing is proposed."""
        try:
            return self._chain.latest(view.camera.frame_id)
        except TransformError as error:
            raise RefusedError(f"it is not known whether the robot has moved since the view: {error}", where="correction") from error

    def _publish(self, proposals: Sequence[Proposed]) -> None:
        first = proposals[0]
        chosen, head = first.correction, first.head
        self.offer(self._outputs["verdict"], lambda: DiagnosticArray(header=head, status=[p.status() for p in proposals]), now="proposal")
        for proposed in proposals:
            self.offer(self._proposal, proposed.message)
        if chosen.accepted:
            self._outputs["pose"].publish(messages.pose(chosen.T_frame_hand, chosen.cov, head))
            self._outputs["delta"].publish(messages.pose_stamped(chosen.delta, messages.header(first.view.stamp_ns, first.frames.hand)))

    def figures(self) -> Mapping[str, str]:
        """Reference or CAD, the last verdict, age of TF."""
        first, scene = self._corrector.reference, self._scene
        return {
            "reference": str(first.stamp_ns) if first else "",
            "scene": f"{self.config.live.scene_name} {scene.digest[:12]}" if scene else "",
            "connected": self.config.live.connect,
            "verdict": self._verdict,
            **(self._feed.figures() if self.active else {}),
        }

    def warnings(self) -> list[str]:
        """Warn if there is neither a reference nor a scene."""
        lacking = self._corrector.reference is None and self._scene is None
        return ["there is no reference and no scene: call ~/capture_reference"] if lacking else []


@dataclass(frozen=True, slots=True, eq=False)
class Proposed:
    """One proposal with the view that it is of."""

    correction: Correction
    view: View
    frames: Frames

    @property
    def head(self) -> Any:
        """Stamp of the view, frame of the target."""
        return messages.header(self.view.stamp_ns, self.frames.frame)

    def message(self) -> Any:
        """As a CorrectionProposal."""
        from tof_ros.results import proposal

        return proposal(self.correction, self.head)

    def status(self) -> DiagnosticStatus:
        """As a status with every figure as text."""
        c = self.correction
        return status(LEVELS[c.verdict], f"correction: {c.by}", f"{c.verdict}: {c.reason}", {k: _text(v) for k, v in c.to_dict().items()})


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def make_node(**options: Any) -> CorrectNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return CorrectNode(**options)
