"""Names of an identification's stages, apart from the code that runs them: importing this loads no numerics."""

from typing import Literal

#: Stage to what is reported while it runs.
WORDS = {
    "check": "checking recordings and equations",
    "cylinder_stage": "stage 1: each drive's friction and stiffness",
    "rigid_body_stage": "stage 2: base parameters with the friction frozen",
    "residual": "noise floor and kinematic check",
    "attribution": "tracing the residual to an effect",
    "refit": "refitting both stages jointly",
    "report": "writing the report",
}
STAGES: tuple[str, ...] = tuple(WORDS)
#: The one stage of an identification of valves (:mod:`fitting.pipeline.valve_stage`); its report, and the folder of the
#: inverses beside that.
VALVE_STAGE, VALVE_REPORT, INVERSES = "valve", "valve.json", "inverse"
VALVE_WORDS = {VALVE_STAGE: "from commands to speeds, valve by valve"}
#: File that the last stage leaves beside the report if it designed a motion.
NEXT_MOTION = "next-experiment.csv"
#: Languages that the last stage can write its page in (:mod:`fitting.report.languages`).
ReportLanguage = Literal["en", "de"]
