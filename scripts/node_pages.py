# SPDX-License-Identifier: Apache-2.0
"""Texts of the nodes' pages, one per node. A test checks the names in them against the code."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Topic:
    """A row of a table of topics."""

    name: str
    type: str
    what: str


@dataclass(frozen=True, slots=True)
class NodeText:
    """The prose of one node's page; `outputs` by topic, `figures` what the node's own values in its diagnostics mean, `more` rows of what is published, `fates` its own results of a frame."""

    short: str
    about: str
    start: tuple[str, ...]
    outputs: dict[str, str]
    figures: dict[str, str]
    warns: str
    more: tuple[tuple[str, str, str], ...] = ()
    fates: str = ""


BEHIND = ", or views come faster than the node takes them (`skipped.overrun`: pushed out of its queue; the message says what to do)"
IMAGE, INFO = "sensor_msgs/Image", "sensor_msgs/CameraInfo"
DEPTH = Topic(
    "`depth/hand/image` (`input.depth_topic`)",
    IMAGE,
    "16UC1 in counts of `input.depth_scale`, or 32FC1 in metres; 0 and 65535 are invalid; a name that ends in `/compressedDepth` or `/compressed` is heard as a CompressedImage",
)
CAMERA = Topic("`depth/hand/camera_info` (`input.info_topic`)", INFO, "intrinsics; the newest message applies")
AMPLITUDE = Topic("`ir/hand/image` (`input.amplitude_topic`)", IMAGE, "optional; frames wait for it once it has been received")
TEMPERATURE = Topic("`hand/temperature` (`input.temperature_topic`)", "sensor_msgs/Temperature", "optional")
TRANSFORMS = Topic(
    "`/tf`, `/tf_static`", "tf2_msgs/TFMessage", "from the cell to the camera's optical frame; interpolated, never extrapolated"
)

TALLY = {
    "rate_hz": "arrivals per second over the last ten seconds",
    "latency_p50_ms": "median time from the arrival of a frame or view to the last output made of it, over the last 256",
    "latency_p95_ms": "95 % quantile of the same",
    "seen": "frames or views that were sent to the node since it began",
    "kept": "those whose outputs are published",
    "skipped": "those without outputs",
    "skipped.REASON": "the same by reason, such as `transform` or `overrun`",
}
"""What the values mean that all nodes count."""
STATE = {"state": "lifecycle state: `unconfigured`, `inactive` or `active`"}
"""The value that a managed node adds."""
SCENE = {"scene": "name of the scene, and the first 12 digits of its hash"}
FEED = {
    "tf_age_s": "age of the newest transform in seconds of wall time",
    "incomplete": "views that were given up, since one of their messages did not come",
}

VIEWS = [
    Topic("`preproc/depth`, `sigma`, `count`, `reason`, `amplitude`", IMAGE, "the running view of each dwell"),
    Topic("`preproc/camera_info`", INFO, "its camera"),
    Topic(
        "`preproc/dwell_info`",
        "toftwin_msgs/Dwell",
        "the dwell and the station of the view; `preproc/dwell` where toftwin_msgs is not installed",
    ),
    TRANSFORMS,
    Topic(
        "`initialpose`",
        "geometry_msgs/PoseWithCovarianceStamped",
        "RViz's 2D Pose Estimate, if TF lacks the cell: in the cell's frame it is the pose of the robot's body, in any other frame the pose of the cell. A pose without height and tilt keeps those of `live.initial_pose`, `placed_in` or the pose before; without any of these, height 0 of that frame is assumed, with a warning. The session begins anew",
    ),
]

UNFILTERED_VIEWS = Topic(
    "`preproc/unfiltered_depth`, `unfiltered_sigma`, `unfiltered_count`, `unfiltered_reason`, `unfiltered_noise`, `amplitude`",
    IMAGE,
    "the view of each dwell before the filters",
)
COLOUR = Topic(
    "`camera/hand/image` (`live.colour_topic`) and its `camera_info`",
    "sensor_msgs/Image, CameraInfo",
    "optional; the newest image of a dwell belongs to its view",
)

IDEAL = Topic(
    "`sim/depth/image` (`input.depth_topic`)",
    IMAGE,
    "ideal depth along the optical axis, 32FC1 in metres or 16UC1; NaN and +inf: nothing there",
)
IDEAL_CAMERA = Topic("`sim/depth/camera_info` (`input.info_topic`)", INFO, "intrinsics; the newest message applies")
ALBEDO = Topic(
    "`sim/ir/image` (`input.amplitude_topic`)",
    IMAGE,
    "optional: albedo or amplitude, as `sensor.light` says; frames wait for it once it has been received",
)
NORMALS = Topic("`live.normals_topic`", IMAGE, "optional: unit normals in the camera's optical frame (32FC3)")
IDEAL_TEMPERATURE = Topic(
    "`sim/temperature` (`input.temperature_topic`)", "sensor_msgs/Temperature", "optional: the camera's temperature, for drift"
)
SCENE_TRANSFORMS = Topic("`/tf`, `/tf_static`", "tf2_msgs/TFMessage", "only with `live.scene`: from the cell to the camera's optical frame")

INPUTS = {
    "preproc": [DEPTH, Topic("`input.points_topic`", "sensor_msgs/PointCloud2", "instead of a depth image"), CAMERA, AMPLITUDE, TEMPERATURE, TRANSFORMS],
    "sim_label": VIEWS,
    "infer": [DEPTH, CAMERA, AMPLITUDE, TEMPERATURE],
    "sensor": [IDEAL, IDEAL_CAMERA, ALBEDO, NORMALS, IDEAL_TEMPERATURE, SCENE_TRANSFORMS],
    "correct": [*VIEWS, COLOUR],
    "inspect": [*VIEWS, COLOUR],
    "gap": [UNFILTERED_VIEWS, *VIEWS[1:], Topic("`label/pose`", "geometry_msgs/PoseWithCovarianceStamped", "solved pose of the camera; `sim_label` must run, and a view that it refuses is not judged")],
}  # fmt: skip

NODE_TEXTS = {
    "preproc": NodeText(
        short="accumulates and filters one camera's stream; every removed pixel keeps its reason",
        about="Accumulates the captures of one dwell (nothing moves) to a running view: mean or median over time, with outliers over time and in space, "
        "flying pixels and grazing pixels removed. Publishes once per capture, with the capture's stamp, or less often (`live.view_every`): with 0 only the last view of each dwell, "
        "with the same values. A label is then made when the next view comes or after the `settle_s` of `sim_label`, and `~/propose` and `~/judge` see the last dwell that ended; `~/capture` ends one at once. While nobody is subscribed no view is computed.",
        start=("toftwin node preproc --namespace spot", "ros2 run toftwin preproc --ros-args -r __ns:=/spot -p preproc.sor.enable:=false"),
        outputs={
            "depth": "running view, metres along z, NaN invalid (32FC1)",
            "sigma": "its standard error, metres (32FC1)",
            "count": "captures that went into the pixel (16UC1)",
            "reason": "why the pixel has no depth: a code of `tof_core.reasons` (8UC1)",
            "amplitude": "mean amplitude in the camera's counts (32FC1); only with an amplitude image",
            "camera_info": "intrinsics of these rasters",
            "points": "the view as an organised cloud, with the amplitude as intensity where there is one; computed only while subscribed",
            "dwell": "`time_ref` is the dwell's first stamp; `source` holds station, number of captures, amplitude yes or no; ends with the next release",
        },
        figures={
            "stages": "the filters that are on, in their order",
            "tf_age_s": FEED["tf_age_s"],
            "waiting": "frames that wait for their amplitude image, CameraInfo or transform",
            "accumulated": "frames that went into a later view of their dwell and were not published themselves",
            "removed.STAGE": "pixels that a filter removed from the latest view; `iqr` and `sigma3` count captures of pixels",
        },
        fates="`accumulated` (part of a later view of its dwell), ",
        warns="frames have no CameraInfo or no transform",
        more=(
            (
                "`preproc/unfiltered_depth`, `unfiltered_sigma`, `unfiltered_count`, `unfiltered_reason`, `unfiltered_noise`",
                IMAGE,
                "the same view accumulated without any filter, and the noise of one capture, for `gap`; computed only while subscribed",
            ),
        ),
    ),
    "sim_label": NodeText(
        short="aligns each view to the CAD and renders its label: the true depth of every pixel",
        about="Aligns the views along one pose chain of the session, using only views that came before, and renders the label at the solved pose. "
        "Publishes once per view, when the next dwell begins or after `live.settle_s`.",
        start=(
            "toftwin node preproc sim_label --scene cell/scene.yaml",
            "ros2 run toftwin sim_label --ros-args -p live.scene:=cell/scene.yaml",
        ),
        outputs={
            "depth": "true depth, metres along z (32FC1)",
            "sigma": "its standard deviation, metres: pose, CAD, edges, unobservable range offset (32FC1)",
            "mask": "1 where the label may be used for training, 0 everywhere where the view is refused (mono8)",
            "part": "index of the part in the scene, -1 none (16SC1)",
            "camera_info": "intrinsics of these rasters",
            "points": "the label as an organised cloud, with the measured amplitude as intensity where there is one; computed only while subscribed",
            "pose": "solved pose of the camera in the cell, with covariance; only of an accepted view, as `CAMERA_aligned` in `/tf` and `label/path` are",
        },
        figures={
            **SCENE,
            "raycaster": "library that casts the rays",
            **FEED,
            "verdict.NAME": "views by verdict since the node started: accepted, or why they were refused",
            "refused": "why the newest refused view was refused",
        },
        warns="views have no transform, or are refused (in all of a session: the cell is elsewhere; the message says who placed it, and what to do)"
        + BEHIND,
    ),
    "infer": NodeText(
        short="corrects the depth of each frame with the trained network; uncertain pixels keep the raw depth",
        about="Publishes one corrected frame per frame, with the frame's stamp. A network that was trained for another camera, or for other ranges, refuses. While nobody is subscribed the network runs once a second, for the diagnostics.",
        start=("toftwin node infer --param infer.infer.model=camera.onnx", "ros2 run toftwin infer --ros-args -p infer.model:=camera.onnx"),
        outputs={
            "depth": "corrected depth, metres along z (32FC1)",
            "sigma": "its standard deviation, metres; infinite where the raw depth is kept (32FC1)",
            "camera_info": "intrinsics of these rasters",
            "points": "the corrected depth as an organised cloud, with the amplitude as intensity where there is one; computed only while subscribed",
        },
        figures={
            "model": "file of the network",
            "device": "processor or accelerator that it runs on",
            "kept_raw": "share of the last frame that keeps its raw depth, 0 to 1",
        },
        warns="the network refuses the camera, or keeps the raw depth in more than half of the image",
    ),
    "sensor": NodeText(
        short="simulates a real camera: ideal depth of any simulator in, what the camera of a sensor.yaml measures out",
        about="Adds the effects of a sensor.yaml (`sensor.model`) to each ideal frame: bias, noise, mixed pixels at edges, lost pixels, amplitude. The random numbers of a frame "
        "are those of `sensor.seed` and its stamp, so the same frames give the same images. Normals come from `live.normals_topic`, from the scene (`live.scene`), or from the depth. "
        "Topics of Gazebo and Isaac Sim: [simulators](../simulators.md).",
        start=(
            "toftwin node sensor --param sensor.sensor.model=sensor.yaml",
            "ros2 run toftwin sensor --ros-args -p sensor.model:=sensor.yaml -p input.depth_topic:=camera/depth_image",
        ),
        outputs={
            "depth": "measured depth, metres along z, NaN where the camera has no return (32FC1)",
            "amplitude": "amplitude in the camera's unit (32FC1)",
            "camera_info": "intrinsics of these rasters",
        },
        figures={"effects": "the effects that are simulated", "scene": "the scene as `live.scene` names it"},
        warns="the camera's unit of amplitude is unknown, or effects of the model need a scene and there is none",
    ),
    "correct": NodeText(
        short="proposes, on request, the pose of the hand at which the next view equals the reference view",
        about="`~/capture_reference` stores the last dwell as the reference (in the file `live.reference`, if given). `~/propose` registers the last dwell to the reference, and to the CAD if "
        "`live.scene` names one. With a reference and a scene there are two proposals; that of the reference is published as `correction/pose`, and that of the CAD stands beside it in `correction/proposal`. The node moves nothing. Only if `live.connect` names the arm's topic (spot_ros2: `arm_pose_commands`) is an "
        "accepted or partial target sent there, in `body`, `odom` or `vision` without the robot's prefix; it is refused if TF has no frame `hand` (or `PREFIX/hand`). **Nothing checks the path or the target for collisions, joint limits or speed**: the limits "
        "are the step (`correct.limits.step_*`) and the target's place about the body (`reach_m`, `low_m`). The driver and you are responsible for the rest. The node refuses, with the reason: an old view, "
        "a robot that has moved since, low support, a step or a target beyond the limits, two dwells that disagree. Along directions that the view does not "
        "determine nothing moves (verdict `partial`). A second command during the first is refused, not queued.",
        start=(
            "toftwin node preproc correct --param correct.live.reference=out/first",
            "ros2 run toftwin correct --ros-args -p live.reference:=out/first",
        ),
        outputs={
            "pose": "target of the hand in `live.frame` (default: the body), with covariance; of the reference where there is one, else of the CAD; only if accepted or partial",
            "delta": "the same as a motion of the hand in its own axes",
            "verdict": "one status for the reference, one for the CAD: OK accepted, WARN partial, ERROR refused, with every figure as text; ends with the next release",
        },
        figures={
            "reference": "stamp of the reference in nanoseconds, empty without one",
            "scene": f"{SCENE['scene']}; empty without one",
            "connected": "the arm's topic, as `live.connect` names it",
            "verdict": "the last proposal's verdict",
            **FEED,
        },
        warns="there is neither a reference nor a scene" + BEHIND,
    ),
    "inspect": NodeText(
        short="decides, on request, for every part: present, absent, displaced or not observable",
        about="`~/judge` solves the poses of the last dwells together and tests every part that the scene marks `inspect: true`. "
        "`~/capture_reference`, called while the scene is complete, keeps the colour images of the last `live.views` dwells in memory, until the node ends; from then on colour is used beside depth. "
        "With `live.out` each call writes inspection.json and inspection.html.",
        start=(
            "toftwin node preproc inspect --scene cell/scene.yaml",
            "ros2 run toftwin inspect --ros-args -p live.scene:=cell/scene.yaml",
        ),
        outputs={
            "verdict": "one status per part: OK present, WARN displaced, ERROR absent, STALE not observable; its values are the figures of the verdict as text; ends with the next release"
        },
        figures={
            **SCENE,
            "inspected": "parts that are judged",
            "first_pictures": "colour images kept by `~/capture_reference`",
            "verdict.STATE": "parts by state at the last `~/judge`: `present`, `absent`, `displaced`, `not_observable`",
            **FEED,
        },
        warns="the last call found parts absent or displaced" + BEHIND,
    ),
    "gap": NodeText(
        short="watches the gap between camera and CAD, and warns once it grows",
        about="Compares each labelled view with the CAD at the label's pose. The gap is the difference beyond noise and pose covariance. The first "
        "`watch.baseline` views define the usual gap; growth is reported at a stated rate of false alarms (`watch.views_per_alarm`). The node takes the views of `preproc` before its filters; "
        "the action `~/diagnose` names the causes from the dwells that it has kept, without a recording.",
        start=(
            "toftwin node preproc sim_label gap --scene cell/scene.yaml",
            "ros2 run toftwin gap --ros-args -p live.scene:=cell/scene.yaml",
        ),
        outputs={
            "residual": "measured minus rendered, metres along z, NaN where either is missing (32FC1)",
            "camera_info": "intrinsics of this raster",
            "report": "JSON: `gap_mm`, `floor_mm`, `usual_mm`, `alarm` (growth is reported at 1), `views`, `state_of_gap`; ends with the next release",
        },
        figures={
            **SCENE,
            "dwells": "dwells kept for `~/diagnose`",
            "state_of_gap": "`learning` (the first `watch.baseline` views), `steady` or `grown`",
            "gap_mm": "gap of the last view: RMS of means of blocks of pixels above `floor_mm`",
            "floor_mm": "RMS of the same means by noise and pose error alone",
            "usual_mm": "median gap of the first `watch.baseline` views, `None` until then",
            "alarm": "0 to 1; at 1, growth is reported",
            "views": "views judged since the baseline began",
            **FEED,
        },
        warns="the gap grows, or a view cannot be judged" + BEHIND,
    ),
}
