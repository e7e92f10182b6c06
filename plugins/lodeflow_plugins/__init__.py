"""The plugins that come with lodeflow; they enter by the same door as anybody's."""

import lodeflow as lf


@lf.hookimpl
def lodeflow_nodes() -> dict[str, str]:
    """Plugin names and where their classes are; nothing is imported until a graph names one."""
    here = "lodeflow_plugins"
    kalman = f"{here}.fusion.quaternion_kalman.node"
    return {
        "simulated_vehicle": f"{here}.sources.simulated_vehicle.node:SimulatedVehicle",
        "csv": f"{here}.sources.csv_file:CsvFile",
        "broad_trial": f"{here}.sources.broad:BroadTrial",
        "recorded_sensors": "lodeflow.recording.source:RecordedSensors",
        "mag_calibrator": f"{here}.calibration.node:MagCalibrator",
        "accel_calibrator": f"{here}.calibration.node:AccelCalibrator",
        "gyro_calibrator": f"{here}.calibration.node:GyroCalibrator",
        "imu_combiner": f"{here}.calibration.node:ImuCombiner",
        "tilt_compass": f"{here}.fusion.tilt_compass.node:TiltCompass",
        "quaternion_kalman": f"{kalman}:QuaternionKalman",
        "chu_fuser": f"{kalman}:ChuFuser",
        "attitude_fuser": f"{here}.fusion.attitude_fuser:AttitudeFuser",
        "inertial_attitude": f"{here}.fusion.inertial_attitude.node:InertialAttitude",
        "heading_kalman": f"{here}.fusion.heading_kalman.node:HeadingKalman",
        "heading_from_attitude": f"{here}.fusion.heading_from_attitude:HeadingFromAttitude",
        "attitude_score": f"{here}.scoring.attitude_score.node:ScoreAttitude",
    }


@lf.hookimpl
def lodeflow_importers() -> dict[str, str]:
    """Formats of `lodeflow import`."""
    return {"broad": "lodeflow_plugins.sources.broad:BroadTrial"}
