# SPDX-License-Identifier: Apache-2.0
"""Point-to-plane ICP of each view to the sampled CAD, by open3d and by small_gicp: what posing a session by library calls costs.

`python -m benchmarks.icp_rivals BAG SCENE LIBRARY` prints the processor seconds of all views together, and the poses, as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bag import open_bag
from tof_scene.builtin import make_builtin
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_core.capture import View

    Align = Callable[[Float, Float], Float]

POINTS = 100_000
"""Of the CAD: some 25 mm apart on a built-in scene; with 300 000 both libraries take half as long again, and are no nearer."""
REACHES_M = (0.15, 0.05, 0.02)
"""Largest distance of correspondences, three rounds: a base is 50 mm off, a filtered depth some millimetres."""
ITERATIONS = 30
"""Of each round at most: open3d's default."""


def open3d(vertices: Float, faces: Any) -> Align:
    """`registration_icp` with point-to-plane estimation."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
    mesh.compute_triangle_normals()
    target = mesh.sample_points_uniformly(POINTS, use_triangle_normal=True)
    icp = o3d.pipelines.registration
    estimation, criteria = icp.TransformationEstimationPointToPlane(), icp.ICPConvergenceCriteria(max_iteration=ITERATIONS)

    def align(points: Float, T: Float) -> Float:
        source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        for reach in REACHES_M:
            T = icp.registration_icp(source, target, reach, T, estimation, criteria).transformation
        return T

    return align


def small_gicp(vertices: Float, faces: Any) -> Align:
    """`align` with PLANE_ICP on one thread; its normals come from neighbours, since it takes none."""
    import open3d as o3d
    import small_gicp as gicp

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
    target = gicp.PointCloud(np.asarray(mesh.sample_points_uniformly(POINTS).points))
    tree = gicp.KdTree(target, num_threads=1)
    gicp.estimate_normals_covariances(target, tree, num_neighbors=20, num_threads=1)

    def align(points: Float, T: Float) -> Float:
        source = gicp.PointCloud(points)
        for reach in REACHES_M:
            T = gicp.align(
                target, source, tree, T, registration_type="PLANE_ICP", max_correspondence_distance=reach, num_threads=1,
                max_iterations=ITERATIONS,
            ).T_target_source  # fmt: skip
        return T

    return align


LIBRARIES: dict[str, Callable[[Float, Any], Align]] = {"open3d": open3d, "small_gicp": small_gicp}


def pose_of(view: View, align: Align) -> Float:
    """The pose (4, 4) of a view by ICP from where TF says it is, of all its pixels with a depth."""
    assert view.robot is not None
    points = view.camera.points(view.depth).reshape(-1, 3).astype(float)
    return align(points[np.isfinite(points[:, 2])], view.robot.T_cell_camera)


def main(bag: str, scene_name: str, library: str) -> None:
    """Filtered views and the libraries' import do not count; sampling the CAD does."""
    __import__(library)
    scene = make_builtin(scene_name)
    with open_bag(bag, cell_frame=scene.frame) as reader:
        views = list(ViewStream(reader, PipelineConfig()))
    vertices, faces, _ = scene.triangles()
    started = time.process_time()
    align = LIBRARIES[library](vertices, faces)
    poses = [pose_of(view, align) for view in views]
    seconds = time.process_time() - started
    print(json.dumps({"seconds": seconds, "stamps": [v.stamp_ns for v in views], "poses": [np.asarray(T).tolist() for T in poses]}))


if __name__ == "__main__":
    main(*sys.argv[1:])
