"""The plugins that come with lodeflow; they enter by the same door as anybody's."""

import lodeflow as lf


@lf.hookimpl
def lodeflow_nodes() -> dict[str, str]:
    """Plugin names and where their classes are; nothing is imported until a graph names one."""
    here = "lodeflow_plugins"
    kalman = f"{here}.fusion.quaternion_kalman.node"
    peers = f"{here}.fusion.peers"
    return {
        "simulated_vehicle": f"{here}.sources.simulated_vehicle.node:SimulatedVehicle",
        "csv": f"{here}.sources.csv_file:CsvFile",
        "broad_trial": f"{here}.sources.broad:BroadTrial",
        "hmr3300": f"{here}.sources.hmr3300:Hmr3300",
        "nmea_heading": f"{here}.sources.nmea_heading:NmeaHeading",
        "turntable": f"{here}.sources.turntable.node:Turntable",
        "vehicle_in_city": f"{here}.sources.vehicle_in_city.node:VehicleInCity",
        "recorded_sensors": "lodeflow.recording.source:RecordedSensors",
        "mag_calibrator": f"{here}.calibration.node:MagCalibrator",
        "accel_calibrator": f"{here}.calibration.node:AccelCalibrator",
        "gyro_calibrator": f"{here}.calibration.node:GyroCalibrator",
        "ellipse_calibrator": f"{here}.calibration.ellipse_calibrator:EllipseCalibrator",
        "imu_combiner": f"{here}.calibration.node:ImuCombiner",
        "tilt_compass": f"{here}.fusion.tilt_compass.node:TiltCompass",
        "quaternion_kalman": f"{kalman}:QuaternionKalman",
        "chu_fuser": f"{kalman}:ChuFuser",
        "vqf": f"{peers}.vqf:Vqf",
        "imufusion": f"{peers}.imufusion:ImuFusion",
        "ahrs_madgwick": f"{peers}.ahrs:AhrsMadgwick",
        "ahrs_mahony": f"{peers}.ahrs:AhrsMahony",
        "heading_from_attitude": f"{here}.fusion.heading_from_attitude:HeadingFromAttitude",
        "dmc_features": f"{here}.interference.dmc_features:DmcFeatures",
        "threshold_stage": f"{here}.interference.threshold_stage:ThresholdStage",
        "fcm_stage": f"{here}.interference.fcm_stage:FcmStage",
        "mode_switch": f"{here}.interference.mode_switch:ModeSwitch",
        "integrated_heading": f"{here}.interference.integrated_heading:IntegratedHeading",
        "gated_kalman": f"{here}.interference.gated_kalman:GatedKalman",
        "heading_estimator": f"{here}.interference.heading_estimator.node:HeadingEstimator",
        "attitude_score": f"{here}.scoring.attitude_score.node:ScoreAttitude",
        "recognition_score": f"{here}.scoring.recognition_score:ScoreRecognition",
        "fcm_score": f"{here}.scoring.recognition_score:ScoreFcm",
        "heading_score": f"{here}.scoring.heading_score:ScoreHeading",
    }


@lf.hookimpl
def lodeflow_importers() -> dict[str, str]:
    """Formats of `lodeflow import`."""
    return {"broad": "lodeflow_plugins.sources.broad:BroadTrial"}
