"""The plugins that come with lodeflow; they enter by the same door as anybody's."""

import lodeflow as lf


@lf.hookimpl
def lodeflow_nodes() -> dict[str, str]:
    """Plugin names and where their classes are; nothing is imported until a graph names one."""
    here = "lodeflow_plugins"
    zero_velocity = f"{here}.pedestrian.zero_velocity.node"
    kalman = f"{here}.fusion.quaternion_kalman.node"
    peers = f"{here}.fusion.peers"
    return {
        "simulated_vehicle": f"{here}.sources.simulated_vehicle.node:SimulatedVehicle",
        "simulated_platform": f"{here}.sources.simulated_platform.node:SimulatedPlatform",
        "csv": f"{here}.sources.csv_file:CsvFile",
        "broad_trial": f"{here}.sources.broad:BroadTrial",
        "foot_trial": f"{here}.sources.foot_trial:FootTrial",
        "airborne_line": f"{here}.sources.airborne_line:AirborneLine",
        "tilting_platform": f"{here}.sources.tilting_platform:TiltingPlatform",
        "hmr3300": f"{here}.sources.hmr3300:Hmr3300",
        "nmea_heading": f"{here}.sources.nmea_heading:NmeaHeading",
        "turntable": f"{here}.sources.turntable.node:Turntable",
        "vehicle_in_city": f"{here}.sources.vehicle_in_city.node:VehicleInCity",
        "recorded_sensors": "lodeflow.recording.source:RecordedSensors",
        "mag_calibrator": f"{here}.calibration.node:MagCalibrator",
        "accel_calibrator": f"{here}.calibration.node:AccelCalibrator",
        "gyro_calibrator": f"{here}.calibration.node:GyroCalibrator",
        "online_mag_calibrator": f"{here}.calibration.online.node:OnlineMagCalibrator",
        "iron_calibrator": f"{here}.calibration.node:IronCalibrator",
        "ellipse_calibrator": f"{here}.calibration.ellipse_calibrator:EllipseCalibrator",
        "imu_combiner": f"{here}.calibration.node:ImuCombiner",
        "tilt_compass": f"{here}.fusion.tilt_compass.node:TiltCompass",
        "quaternion_kalman": f"{kalman}:QuaternionKalman",
        "chu_fuser": f"{kalman}:ChuFuser",
        "vqf": f"{peers}.vqf:Vqf",
        "offline_vqf": f"{peers}.offline_vqf:OfflineVqf",
        "imufusion": f"{peers}.imufusion:ImuFusion",
        "ahrs_madgwick": f"{peers}.ahrs:AhrsMadgwick",
        "ahrs_mahony": f"{peers}.ahrs:AhrsMahony",
        "attitude_fuser": f"{here}.fusion.attitude_fuser.node:AttitudeFuser",
        "offline_attitude": f"{here}.fusion.offline_attitude.node:OfflineAttitude",
        "inertial_attitude": f"{here}.fusion.inertial_attitude.node:InertialAttitude",
        "heading_kalman": f"{here}.fusion.heading_kalman.node:HeadingKalman",
        "heading_from_attitude": f"{here}.fusion.heading_from_attitude:HeadingFromAttitude",
        "imu_decimator": f"{here}.pedestrian.decimation:ImuDecimator",
        "to_geographic": f"{here}.pedestrian.geographic.node:ToGeographic",
        "euler_to_geographic": f"{here}.pedestrian.geographic.node:EulerToGeographic",
        "zero_velocity_steps": f"{zero_velocity}:ZeroVelocitySteps",
        "raw_norm_steps": f"{zero_velocity}:RawNormSteps",
        "shoe_steps": f"{zero_velocity}:ShoeSteps",
        "ared_steps": f"{zero_velocity}:AredSteps",
        "amvd_steps": f"{zero_velocity}:AmvdSteps",
        "mag_steps": f"{zero_velocity}:MagSteps",
        "gyro_norm_steps": f"{here}.pedestrian.peaks.node:GyroNormSteps",
        "acceleration_peak_steps": f"{here}.pedestrian.peaks.node:AccelerationPeakSteps",
        "autocorrelation_steps": f"{here}.pedestrian.rhythm.node:AutocorrelationSteps",
        "swing_steps": f"{here}.pedestrian.swing.node:SwingSteps",
        "step_track": f"{here}.pedestrian.dead_reckoning.node:StepTrack",
        "stance_track": f"{here}.pedestrian.dead_reckoning.node:StanceTrack",
        "track_score": f"{here}.scoring.track_score.node:ScoreTrack",
        "step_score": f"{here}.scoring.step_score.node:ScoreSteps",
        "eotvos": f"{here}.gravimetry.earth.node:Eotvos",
        "horizontal_coriolis": f"{here}.gravimetry.earth.node:HorizontalCoriolis",
        "disturbing_gravity": f"{here}.gravimetry.earth.node:DisturbingGravity",
        "kinematic_acceleration": f"{here}.gravimetry.earth.node:KinematicAcceleration",
        "tilt_correction": f"{here}.gravimetry.tilt.node:TiltCorrection",
        "tilt_error_budget": f"{here}.gravimetry.tilt.node:TiltErrorBudget",
        "gravity_low_pass": f"{here}.gravimetry.tilt.node:GravityLowPass",
        "gravity_score": f"{here}.scoring.gravity_score.node:ScoreGravity",
        "dmc_features": f"{here}.interference.dmc_features:DmcFeatures",
        "threshold_stage": f"{here}.interference.threshold_stage:ThresholdStage",
        "fcm_stage": f"{here}.interference.fcm_stage:FcmStage",
        "mode_switch": f"{here}.interference.mode_switch:ModeSwitch",
        "integrated_heading": f"{here}.interference.integrated_heading:IntegratedHeading",
        "gated_kalman": f"{here}.interference.gated_kalman:GatedKalman",
        "heading_estimator": f"{here}.interference.heading_estimator.node:HeadingEstimator",
        "attitude_heading_estimator": (
            f"{here}.interference.heading_estimator.attitude_node:AttitudeHeadingEstimator"
        ),
        "attitude_score": f"{here}.scoring.attitude_score.node:ScoreAttitude",
        "recognition_score": f"{here}.scoring.recognition_score:ScoreRecognition",
        "fcm_score": f"{here}.scoring.recognition_score:ScoreFcm",
        "heading_score": f"{here}.scoring.heading_score:ScoreHeading",
    }


@lf.hookimpl
def lodeflow_messages() -> list[str]:
    """Modules that declare message types."""
    return ["lodeflow_plugins.calibration.messages"]


@lf.hookimpl
def lodeflow_importers() -> dict[str, str]:
    """Formats of `lodeflow import`."""
    return {
        "broad": "lodeflow_plugins.sources.broad:BroadTrial",
        "airborne": "lodeflow_plugins.sources.airborne_line:AirborneLine",
        "foot": "lodeflow_plugins.sources.foot_trial:FootTrial",
    }


@lf.hookimpl
def lodeflow_calibrations() -> dict[str, str]:
    """Kinds of `lodeflow calibrate`."""
    tools = "lodeflow_plugins.calibration.tools"
    compasses = "lodeflow_plugins.interference.tools"
    return {
        "mag": f"{tools}.mag:Mag",
        "iron": f"{tools}.iron:Iron",
        "accel": f"{tools}.accel:Accel",
        "gyro": f"{tools}.gyro:Gyro",
        "gyro-bias": f"{tools}.gyro:GyroBias",
        "allan": f"{tools}.allan:Allan",
        "ellipse": f"{tools}.ellipse:EllipseFit",
        "pair": f"{compasses}:Pair",
        "fcm": f"{compasses}:FcmClusters",
    }
