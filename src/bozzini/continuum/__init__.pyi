from .arc import ArcModel, arc_frames, bend_vectors, displacements_for, jacobian
from .calibration import Marker, RobotCalibration
from .contact import ContactModel, ContactOptions, ContactShape
from .continuation import EquilibriumPath
from .control import (
    AimedTip,
    HeldTip,
    LinearQuadratic,
    ProportionalIntegral,
    ResolvedRates,
    StaticTensions,
    TendonChoice,
    TendonController,
    TendonState,
    TensionPrediction,
)
from .coupling import BendSolution, ParallelModel, check_displacements, coupling_matrix
from .dynamics import (
    DynamicsOptions,
    EnergyBalance,
    LinearDynamics,
    MotionCommands,
    RodMotion,
    ShapeHistory,
    linearise,
    push_in,
    simulate,
)
from .elastic import ElasticModel
from .energy import EnergyModel
from .error_fit import (
    AheadPrediction,
    ErrorFit,
    EstimateHistory,
    SensorRecord,
    fit_model_error,
    follow_record,
    predict_unread,
)
from .estimation import ShapeEstimator
from .fit_search import RobotFitOptions
from .friction import FrictionState
from .gradients import ShapeJacobian
from .history import TendonHistory
from .insertion import DriveTable, InsertionResult, insert_robot
from .inverse import (
    ContinuumInverse,
    InverseOptions,
    SectionResult,
    solve_curve,
    solve_pose,
    solve_section,
    solve_tip,
)
from .kinematics import ContinuumRobot
from .left_out import Validation
from .linkage import LinkageModel
from .loads import LineLoad, PackedLoads, PointLoad, pack_loads
from .measured import (
    RobotMeasurements,
    RobotRows,
    TimedCommands,
    read_robot_measurements,
    read_robot_rows,
    read_timed_commands,
)
from .model import ContinuumModel
from .model_error import ModelError, UnknownLoad
from .models import CONTINUUM_MODELS
from .motion_gradients import MotionSensitivity, differentiate_motion
from .motion_log import write_mcap
from .predicting import PredictedRows, RobotPredicting, predict_rows
from .prediction_band import PredictionBand
from .robot import RobotDesign
from .robot_fit import Estimate, RobotCheck, RobotFit, fit_robot
from .robot_prediction import RobotPrediction, predict_points
from .rod import RodModel
from .section import Helix, Section, Tendon
from .section_residual import SectionResidual
from .sensing import SensorChoice, SensorPlan, SensorPlanning, plan_sensors
from .sensor_table import SensorNoise, SensorTable, read_sensor_table
from .sensors import (
    BodySensor,
    CurvatureSensor,
    PlaceSensor,
    PoseSensor,
    SightSensor,
    StrainSensor,
    TensionSensor,
)
from .shape import Shape
from .shape_estimate import EstimatedContact, EstimatedLoad, EstimatorState, ShapeEstimate
from .staged_fit import FitStage, StagedFit, fit_in_stages
from .tracking import (
    TENDON_CONTROLLERS,
    ContinuumTracking,
    TendonRun,
    TendonTrackedBy,
    TendonTracking,
    compare_tendons,
    run_tendons,
    soften,
)
from .unknowns import RobotSetup, Unknown, parse_unknowns
from .wire import Wire
from .workspace import (
    ContinuumWorkspace,
    Dexterity,
    DexterityMap,
    Manipulability,
    TendonTravel,
    WorkspaceSample,
    WorkspaceVolume,
    manipulability,
    measure_dexterity,
    measure_workspace,
    sample_workspace,
)

__all__ = [
    "PredictionBand",
    "RobotCheck",
    "SectionResidual",
    "FitStage",
    "StagedFit",
    "fit_in_stages",
    "AimedTip",
    "HeldTip",
    "LinearQuadratic",
    "ProportionalIntegral",
    "ResolvedRates",
    "StaticTensions",
    "TendonChoice",
    "TendonController",
    "TendonState",
    "TensionPrediction",
    "TENDON_CONTROLLERS",
    "ContinuumTracking",
    "TendonRun",
    "TendonTrackedBy",
    "TendonTracking",
    "compare_tendons",
    "run_tendons",
    "soften",
    "CONTINUUM_MODELS",
    "ArcModel",
    "BendSolution",
    "ContactModel",
    "ContactOptions",
    "ContactShape",
    "ContinuumInverse",
    "ContinuumModel",
    "ContinuumRobot",
    "ContinuumWorkspace",
    "Dexterity",
    "DexterityMap",
    "DriveTable",
    "DynamicsOptions",
    "ElasticModel",
    "EnergyBalance",
    "EnergyModel",
    "EquilibriumPath",
    "FrictionState",
    "Helix",
    "InsertionResult",
    "InverseOptions",
    "LineLoad",
    "LinearDynamics",
    "LinkageModel",
    "Manipulability",
    "MotionCommands",
    "MotionSensitivity",
    "PackedLoads",
    "ParallelModel",
    "PointLoad",
    "RobotDesign",
    "RodModel",
    "RodMotion",
    "Section",
    "SectionResult",
    "Shape",
    "ShapeHistory",
    "ShapeJacobian",
    "TendonHistory",
    "Tendon",
    "TendonTravel",
    "Wire",
    "WorkspaceSample",
    "WorkspaceVolume",
    "arc_frames",
    "bend_vectors",
    "check_displacements",
    "coupling_matrix",
    "differentiate_motion",
    "displacements_for",
    "insert_robot",
    "jacobian",
    "linearise",
    "manipulability",
    "measure_dexterity",
    "measure_workspace",
    "pack_loads",
    "sample_workspace",
    "push_in",
    "simulate",
    "solve_curve",
    "solve_pose",
    "solve_section",
    "solve_tip",
    "write_mcap",
    "Estimate",
    "RobotCalibration",
    "RobotFit",
    "RobotFitOptions",
    "RobotPrediction",
    "Validation",
    "fit_robot",
    "predict_points",
    "Marker",
    "RobotMeasurements",
    "TimedCommands",
    "read_robot_measurements",
    "read_timed_commands",
    "RobotSetup",
    "Unknown",
    "parse_unknowns",
    "ModelError",
    "ShapeEstimator",
    "UnknownLoad",
    "BodySensor",
    "CurvatureSensor",
    "PlaceSensor",
    "PoseSensor",
    "SightSensor",
    "StrainSensor",
    "TensionSensor",
    "EstimatedContact",
    "EstimatedLoad",
    "EstimatorState",
    "ShapeEstimate",
    "AheadPrediction",
    "ErrorFit",
    "EstimateHistory",
    "SensorRecord",
    "fit_model_error",
    "follow_record",
    "PredictedRows",
    "RobotPredicting",
    "RobotRows",
    "predict_rows",
    "read_robot_rows",
    "predict_unread",
    "SensorNoise",
    "SensorTable",
    "read_sensor_table",
    "SensorChoice",
    "SensorPlan",
    "SensorPlanning",
    "plan_sensors",
]
