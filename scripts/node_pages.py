# SPDX-License-Identifier: Apache-2.0
"""What the nodes' pages say that the code does not: one text a node. Names are checked against the code by a test."""

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
    """The prose of one node's page; `outputs` by topic, `figures` are the node's own values in its diagnostics."""

    short: str
    about: str
    start: tuple[str, ...]
    outputs: dict[str, str]
    figures: tuple[str, ...]
    warns: str


IMAGE, INFO = "sensor_msgs/Image", "sensor_msgs/CameraInfo"
DEPTH = Topic(
    "`depth/hand/image` (`input.depth_topic`)", IMAGE, "16UC1 in counts of `input.depth_scale`, or 32FC1 in metres; 0 and 65535 are invalid"
)
CAMERA = Topic("`depth/hand/camera_info` (`input.info_topic`)", INFO, "intrinsics; the newest one holds")
AMPLITUDE = Topic("`ir/hand/image` (`input.amplitude_topic`)", IMAGE, "optional; waited for once it has been seen")
TEMPERATURE = Topic("`hand/temperature` (`input.temperature_topic`)", "sensor_msgs/Temperature", "optional")
TRANSFORMS = Topic(
    "`/tf`, `/tf_static`", "tf2_msgs/TFMessage", "from the cell to the camera's optical frame; interpolated, never extrapolated"
)

VIEWS = [
    Topic("`preproc/depth`, `sigma`, `count`, `reason`, `amplitude`", IMAGE, "the running view of each dwell"),
    Topic("`preproc/camera_info`", INFO, "its camera"),
    Topic("`preproc/dwell`", "sensor_msgs/TimeReference", "which dwell and station it belongs to"),
    TRANSFORMS,
]

COLOUR = Topic(
    "`camera/hand/image` (`live.colour_topic`) and its `camera_info`",
    "sensor_msgs/Image, CameraInfo",
    "optional: the newest of a dwell goes with its view",
)

INPUTS = {
    "preproc": [DEPTH, Topic("`input.points_topic`", "sensor_msgs/PointCloud2", "instead of a depth image"), CAMERA, AMPLITUDE, TEMPERATURE, TRANSFORMS],
    "sim_label": VIEWS,
    "infer": [DEPTH, CAMERA, AMPLITUDE, TEMPERATURE],
    "correct": [*VIEWS, COLOUR],
    "inspect": [*VIEWS, COLOUR],
    "gap": [*VIEWS, Topic("`label/pose`", "geometry_msgs/PoseWithCovarianceStamped", "where the camera really was: `sim_label` must run")],
}  # fmt: skip

NODE_TEXTS = {
    "preproc": NodeText(
        short="accumulates and filters one camera's stream; every removed pixel keeps its reason",
        about="Captures of one dwell (nothing moves) become one running view: mean or median over time, outliers over time and in space removed, "
        "flying and grazing pixels masked. Once per capture, with the capture's stamp.",
        start=("toftwin node preproc --namespace spot", "ros2 run toftwin preproc --ros-args -r __ns:=/spot -p preproc.sor.enable:=false"),
        outputs={
            "depth": "running view, metres along z, NaN invalid (32FC1)",
            "sigma": "its standard error, metres (32FC1)",
            "count": "captures that went into the pixel (16UC1)",
            "reason": "why the pixel has no depth, `tof_core.reasons` (8UC1)",
            "amplitude": "mean amplitude in the camera's counts (32FC1), where it has one",
            "camera_info": "intrinsics of these rasters",
            "points": "the view as an organised cloud; made only while somebody listens",
            "dwell": "`time_ref` is the dwell's first stamp; `source` says station, captures, amplitude",
        },
        figures=("stages", "tf_age_s", "waiting", "removed.STAGE"),
        warns="frames have no CameraInfo or no transform",
    ),
    "sim_label": NodeText(
        short="aligns each view to the CAD and ray casts its label: what every pixel really measures",
        about="Views are aligned in one chain over the session, with what came before only; the label is rendered at the solved pose. "
        "Once per view, when the next dwell begins or after `live.settle_s`.",
        start=(
            "toftwin node preproc sim_label --scene cell/scene.yaml",
            "ros2 run toftwin sim_label --ros-args -p live.scene:=cell/scene.yaml",
        ),
        outputs={
            "depth": "true distance, metres along z (32FC1)",
            "sigma": "its standard deviation, metres: pose, edges, what cannot be seen (32FC1)",
            "mask": "255 where it may be trained on (mono8)",
            "part": "index of the part in the scene, -1 none (16SC1)",
            "camera_info": "intrinsics of these rasters",
            "points": "the label as an organised cloud; made only while somebody listens",
            "pose": "where the camera really was in the cell, with covariance",
        },
        figures=("scene", "raycaster", "tf_age_s", "incomplete", "verdict.NAME"),
        warns="views have no transform",
    ),
    "infer": NodeText(
        short="repairs each frame with the trained network; what it does not know stays raw",
        about="One frame in, one frame out, with the frame's stamp. A network that was made for another camera, or that does not know what it sees, refuses.",
        start=("toftwin node infer", "ros2 run toftwin infer --ros-args -p infer.model:=out/model.onnx"),
        outputs={
            "depth": "repaired distance, metres along z (32FC1)",
            "sigma": "its standard deviation, metres; infinite where the raw depth stands (32FC1)",
            "camera_info": "intrinsics of these rasters",
        },
        figures=("model", "device", "kept_raw"),
        warns="the network refuses the camera, or keeps more than half of the picture raw",
    ),
    "correct": NodeText(
        short="proposes, on request, where the hand must go so that the next picture is the first picture again",
        about="`~/capture_reference` keeps the last dwell as the first picture (in the file `live.reference`, where that is given); `~/propose` registers the last dwell to it, and to the CAD where "
        "`live.scene` names one. It proposes and never orders: only where `live.connect` names the arm's topic (spot_ros2: `arm_pose_commands`) is an "
        "accepted target sent there, in `body`, `odom` or `vision` without the robot's prefix, for the frame `hand`. Refused with the reason: a view that is "
        "stale, a robot that moved meanwhile, low support, a step or a place beyond the limits, two dwells that disagree; along directions that the view does not "
        "determine nothing is moved (verdict `partial`). A second command during the first is refused, not queued.",
        start=(
            "toftwin node preproc correct --param correct.live.reference=out/first",
            "ros2 run toftwin correct --ros-args -p live.reference:=out/first",
        ),
        outputs={
            "pose": "target of the hand in `live.frame` (default: the body), with covariance; only of an accepted proposal",
            "delta": "the same as a motion of the hand in its own axes",
            "verdict": "one status for the reference, one for the CAD: OK accepted, WARN partial, ERROR refused, with every figure",
        },
        figures=("reference", "scene", "connected", "verdict", "tf_age_s", "incomplete"),
        warns="there is neither a first picture nor a scene",
    ),
    "inspect": NodeText(
        short="judges, on request, whether every part is there: present, absent, displaced, not observable",
        about="`~/judge` solves the poses of the last dwells together and weighs every part that the scene marks `inspect: true`. "
        "`~/capture_reference`, called while the scene is complete, keeps the colour of the last dwells in memory; colour is weighed beside depth from then on. "
        "With `live.out` each judgement writes inspection.json and inspection.html.",
        start=(
            "toftwin node preproc inspect --scene cell/scene.yaml",
            "ros2 run toftwin inspect --ros-args -p live.scene:=cell/scene.yaml",
        ),
        outputs={
            "verdict": "one status a part: OK present, WARN displaced, ERROR absent, STALE not observable; its values are the verdict's figures"
        },
        figures=("scene", "inspected", "first_pictures", "verdict.STATE", "tf_age_s", "incomplete"),
        warns="the last judgement found parts absent or displaced",
    ),
    "gap": NodeText(
        short="watches the gap between camera and CAD, and warns once it grows",
        about="Each labelled view is held against the CAD at the label's pose; what neither scatter nor the pose's covariance owes is the gap. The first "
        "`watch.baseline` views say what is usual; growth is told at a stated rate of false alarms (`watch.views_per_alarm`). It sees what `preproc` publishes: "
        "a diagnosis of causes is `toftwin gap` on a recording.",
        start=(
            "toftwin node preproc sim_label gap --scene cell/scene.yaml",
            "ros2 run toftwin gap --ros-args -p live.scene:=cell/scene.yaml",
        ),
        outputs={
            "residual": "measured minus rendered, metres along z, NaN where either is missing (32FC1)",
            "camera_info": "intrinsics of this raster",
            "report": "JSON: `gap_mm`, `floor_mm`, `usual_mm`, `alarm` (at 1 growth is told), `views`, `state_of_gap`",
        },
        figures=("scene", "state_of_gap", "gap_mm", "floor_mm", "usual_mm", "alarm", "views", "tf_age_s", "incomplete"),
        warns="the gap grows, or a view cannot be judged",
    ),
}
