"""Calibration of contact laws from measured restitutions.

    import calibration as cal

    data = cal.RestitutionData(velocity, restitution, contact=pair)
    result = cal.fit(data)
    print(result)

Importing this imports no solver and no optimiser; each name is loaded when it is asked for.
"""

from calibration.lazily import loaded

_WHERE = {
    "RestitutionData": "data.measurements",
    "PointErrors": "data.errors_of_points",
    "plausibility": "data.plausible",
    "InputError": "errors",
    "DataError": "errors",
    "Parameter": "parameters",
    "read_csv": "data.csv_file",
    "read_toml": "data.toml_file",
    "read_problem": "problem_file",
    "paper_materials": "data.paper",
    "PAPER_NOTE": "data.paper",
    "LAWS": "fitting.known_laws",
    "fit": "fitting.door",
    "problem": "fitting.traceable",
    "FitResult": "fitting.result",
    "MaterialFit": "fitting.material",
    "Estimate": "fitting.estimate",
    "Band": "fitting.estimate",
    "Line": "fitting.estimate",
    "Stage": "fitting.stages",
    "Profile": "fitting.profiles",
    "Doubt": "fitting.doubt",
    "LeaveOneOut": "fitting.left_out",
    "Bootstrap": "fitting.refits",
    "compare": "studies.ranking",
    "Comparison": "studies.comparison",
    "export": "handover.door",
    "Export": "handover.exported",
    "coverage_study": "coverage.batched",
    "Inputs": "studies.inputs",
    "of_law": "studies.inputs",
    "of_spheres": "studies.inputs",
    "sensitivity": "studies.local",
    "fisher_information": "studies.information",
    "optimal_velocities": "studies.design",
    "sobol_indices": "studies.sobol",
    "model_indices": "studies.sobol",
}

__all__ = sorted(_WHERE)


def __getattr__(name: str):
    return loaded(__name__, _WHERE, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
