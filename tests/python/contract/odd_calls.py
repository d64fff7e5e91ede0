"""Arguments that public functions take, of which single ones are then replaced by odd ones."""

from __future__ import annotations

from typing import Any

import numpy as np

import sfmcpp
from sfmcpp.map import map_of_problem
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.sensors import Mounting
from sfmcpp.study.evaluation import AlignmentRule, ImagePoses, associate
from sfmcpp.weighting import PoseConstraint, PoseView

SCENE = sfmcpp.circle_scene(4, 30, seed=0)
INTRINSICS, CAMERA = SCENE.intrinsics[0], SCENE.cameras[0]
PIXELS_1, PIXELS_2 = (SCENE.pixels[SCENE.camera_index == image] for image in (0, 1))
STAMPS = np.arange(6.0)
POSES = np.stack([np.hstack([np.eye(3), [[k], [k * k / 10], [k % 2]]]) for k in range(6)])
PATH = Trajectory(STAMPS, POSES)
TURNS = SensorStream(STAMPS, np.full((6, 3), 0.01), "angular_rate")
SPEED = SensorStream(STAMPS, np.ones((6, 1)), "speed")
WAY = SensorStream(STAMPS, STAMPS[:, None], "distance")
POSE = SensorStream(STAMPS, np.hstack([POSES[:, :, 3], np.zeros((6, 3))]), "pose")
POSITION = SensorStream(STAMPS, POSES[:, :, 3], "position")
GEODETIC = SensorStream(STAMPS, np.tile([46.0, 9.0, 100.0], (6, 1)), "geodetic")
NAMED = ImagePoses(tuple("abcdef"), POSES)
ORIENTATION = SensorStream(STAMPS, np.zeros((6, 3)), "orientation")
CONSTRAINT = PoseConstraint("position", translation=CAMERA[:, 3], sensor_sigma=0.1)

# What an argument of a name is, where nothing else is said of the function.
BY_NAME: dict[str, Any] = {
    "admissible": np.ones(3, dtype=bool),
    "angular_rate_rad_s": np.zeros(3),
    "camera": CAMERA,
    "camera_index": SCENE.camera_index,
    "camera_model": "calibrated",
    "constraint": CONSTRAINT,
    "constraints": [],
    "count": 10,
    "distances_m": np.ones(5),
    "end_s": 2.0,
    "errors_deg": np.ones(3),
    "estimate": PATH,
    "first_s": 0.0,
    "geodetic": np.array([[46.0, 9.0, 100.0]]),
    "inliers": np.arange(3),
    "initial_inliers": 2,
    "intrinsics": INTRINSICS,
    "intrinsics_1": INTRINSICS,
    "keypoints": [PIXELS_1, PIXELS_2],
    "last_s": 2.0,
    "length_m": 0.5,
    "lengths": [[0.5, 1.0]],
    "matches": {(0, 1): np.stack([np.arange(20)] * 2, axis=1)},
    "measured": POSES[:, :, 3],
    "model": SCENE,
    "mounting": Mounting(np.eye(3), np.zeros(3)),
    "name": "calibrated",
    "num_cameras": 6,
    "num_points": 60,
    "options": sfmcpp.SolveOptions(),
    "origin": np.array([46.0, 9.0, 100.0]),
    "pairs": 3,
    "pixel_sigma": 1.0,
    "pixels": PIXELS_1,
    "pixels_1": PIXELS_1,
    "pixels_2": PIXELS_2,
    "point_index": SCENE.point_index,
    "points": SCENE.points,
    "pose": POSES[0],
    "poses": POSES,
    "problem": SCENE,
    "projections": SCENE.cameras,
    "rest": np.ones(3),
    "rotation": CAMERA[:, :3],
    "rotations": POSES[:, :, :3],
    "scores": np.arange(15.0),
    "seconds": 0.1,
    "seed": 0,
    "share": 0.1,
    "size": (640, 480),
    "start": CAMERA,
    "start_s": 1.0,
    "stream": TURNS,
    "streams": [TURNS],
    "t_s": STAMPS,
    "text": "loo",
    "threshold_deg": 1.0,
    "threshold_px": 2.0,
    "time_s": 1.5,
    "times_s": STAMPS[1:3],
    "trajectory": PATH,
    "truth": PATH,
    "turn": np.eye(3),
    "vectors": POSES[:, :, 3],
    "velocity_m_s": np.ones(3),
    "view": PoseView(SCENE.points, PIXELS_1, INTRINSICS),
    "vision": POSES[:, :, 3],
    "vision_pose": CAMERA,
    "weight": 1.0,
    "weights": np.arange(3.0),
    "world": map_of_problem(SCENE),
}
TWO_PATHS = {"estimate": POSES, "truth": POSES}
CURVE = {"constraint": np.ones(3)}
BY_FUNCTION: dict[str, dict[str, Any]] = {
    "ConstraintGroup": {"kind": "position", "cameras": [0], "values": np.zeros((1, 3))},
    "Problem": {"cameras": SCENE.cameras, "intrinsics": SCENE.intrinsics, "pixels": SCENE.pixels},
    "corridor_scene": {"length_m": 5.0, "num_points": 200},
    "geometry.agreeing_pairs": {"source": SCENE.points[:6], "target": SCENE.points[:6]},
    "geometry.fit_pose_similarity": {"source": POSES, "target": POSES},
    "geometry.fit_similarity": {"source": SCENE.points, "target": SCENE.points},
    "geometry.focal_from_pairs": {"pairs": [(PIXELS_1, PIXELS_2)]},
    "model.SensorStream": {"values": np.zeros((6, 3)), "kind": "angular_rate"},
    "model.constraint_kind": {"name": "position"},
    "projective_problem": {"pixels": SCENE.pixels},
    "sensors.camera_displacement": {"stream": SensorStream(STAMPS, np.ones((6, 3)), "velocity")},
    "sensors.carried_over": {"stream": SPEED, "stretches": []},
    "sensors.check_bends": {"stream": POSITION, "vision": PATH},
    "sensors.check_position_clock": {"stream": POSITION, "path": PATH},
    "sensors.check_rotations": {"vision": PATH},
    "sensors.counter_leaps": {"stream": WAY},
    "sensors.dead_stretches": {"stream": SPEED, "turns": []},
    "sensors.describe_counter_leaps": {"stream": WAY},
    "sensors.doubtful_stretches": {"stream": SPEED},
    "sensors.local_positions": {"stream": GEODETIC},
    "sensors.pose_at": {"stream": POSE},
    "sensors.position_at": {"stream": POSITION},
    "sensors.smoothed_positions": {"stream": POSITION},
    "sensors.displaced_positions": {"stream": POSITION},
    "sensors.longest_lost_fix": {"stream": POSITION, "sigma_m": 1.0},
    "sensors.without_counter_leaps": {"stream": WAY},
    "sensors.without_leaps": {"stream": POSITION},
    "sensors.without_repeats": {"stream": POSITION},
    "sensors.register_by_distances": {"vision": POSES},
    "sensors.register_by_poses": {"vision": POSES, "measured": POSES},
    "sensors.register_by_positions": {"vision": POSES},
    "sensors.travelled_distance": {"stream": SPEED},
    "slam.TrackSequence": {
        "t_s": [0.0, 1.0],
        "frame_index": [0, 1],
        "track_index": [0, 0],
        "pixels": np.ones((2, 2)),
    },
    "street_loop_scene": {"length_m": 20.0, "width_m": 15.0, "num_cameras": 20, "num_points": 400},
    "study.evaluation.ImagePoses": {"names": tuple("abcdef")},
    "study.evaluation.align": {"pairs": associate(PATH, PATH), "rule": AlignmentRule("all")},
    "study.evaluation.ape": TWO_PATHS,
    "study.evaluation.evaluate_model": {"model": NAMED, "truth": NAMED},
    "study.evaluation.mean_3d_error": TWO_PATHS,
    "study.evaluation.relative_pose_errors_deg": TWO_PATHS,
    "study.evaluation.rpe": TWO_PATHS,
    "study.evaluation.scale_ratios": TWO_PATHS,
    "weighting.PoseConstraint": {"kind": "position"},
    "weighting.filter_orientations": {
        "turns": POSES[1:, :, :3],
        "measured": POSES[:, :, :3],
        "turn_sigma_rad": 0.1,
        "measured_sigma_rad": 0.1,
    },
    "weighting.filter_trajectory": {
        "stream": ORIENTATION,
        "turn_sigma_rad_sqrt_s": 0.1,
        "orientation_sigma_rad": 0.1,
    },
    "weighting.l_curve_scores": CURVE,
    "weighting.lowest": {"scores": np.arange(3.0)},
    "weighting.lowest_valley": {"scores": np.arange(3.0)},
    "weighting.ltn_scores": CURVE,
    "weighting.scaled_l_curve_scores": CURVE,
    "weighting.select_weights": {"constraints": [CONSTRAINT]},
}
