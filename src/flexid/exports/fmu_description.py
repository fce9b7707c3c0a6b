"""``modelDescription.xml`` and ``buildDescription.xml`` of FMI 2.0 and 3.0."""

from xml.etree import ElementTree as ET

import flexid
from flexid.exports.fmu_model import FmuModel, Variable

Version = str
"""``"2.0"`` or ``"3.0"``."""


def model_description(model: FmuModel, version: Version) -> bytes:
    """The description of an FMU for co-simulation."""
    is_2 = version == "2.0"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.identifier,
            ("guid" if is_2 else "instantiationToken"): model.token,
            "description": model.description,
            "generationTool": f"flexid {flexid.__version__}",
        },
    )
    co_simulation = ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canHandleVariableCommunicationStepSize": _flag(not model.fixed_step),
            ("canGetAndSetFMUstate" if is_2 else "canGetAndSetFMUState"): "true",
        },
    )
    if is_2:
        files = ET.SubElement(co_simulation, "SourceFiles")
        for name in sources(model, version):
            ET.SubElement(files, "File", {"name": name})
    elif model.fixed_step:
        co_simulation.set("fixedInternalStepSize", repr(model.step))
    units = dict.fromkeys(v.unit for v in (*model.variables, _TIME) if v.unit)
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in units:
        ET.SubElement(definitions, "Unit", {"name": unit})
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0.0", "stepSize": repr(model.step)})
    variables = ET.SubElement(root, "ModelVariables")
    _variable(variables, _TIME, 0, is_2)
    for variable in model.variables:
        _variable(variables, variable, model.reference(variable), is_2)
    _structure(ET.SubElement(root, "ModelStructure"), model, is_2)
    return _bytes(root)


def build_description(model: FmuModel) -> bytes:
    """How an FMU of FMI 3.0 is compiled."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": model.identifier})
    files = ET.SubElement(build, "SourceFileSet", {"language": "C99"})
    for name in sources(model, "3.0"):
        ET.SubElement(files, "SourceFile", {"name": name})
    return _bytes(root)


def sources(model: FmuModel, version: Version) -> tuple[str, ...]:
    """Names of the files that are to be compiled."""
    own = (name for name in model.sources if name.endswith(".c"))
    return (f"fmi{version[0]}.c", *own)


_TIME = Variable("time", "output", None, "s", "simulated time")


def _variable(parent: ET.Element, variable: Variable, reference: int, is_2: bool) -> None:
    causality, variability, initial = _kind(variable)
    attributes = {"name": variable.name, "valueReference": str(reference)}
    if variable.description:
        attributes["description"] = variable.description
    attributes |= {"causality": causality, "variability": variability}
    if initial:
        attributes["initial"] = initial
    kind = {}
    if variable.start is not None:
        kind["start"] = repr(variable.start)
    if variable.unit:
        kind["unit"] = variable.unit
    if is_2:
        scalar = ET.SubElement(parent, "ScalarVariable", attributes)
        ET.SubElement(scalar, "Integer" if variable.integer else "Real", kind)
    else:
        ET.SubElement(parent, "Int32" if variable.integer else "Float64", attributes | kind)


def _kind(variable: Variable) -> tuple[str, str, str]:
    """Causality, variability and how it is initialised; empty where the standard says it."""
    if variable is _TIME:
        return "independent", "continuous", ""
    if variable.causality == "input":
        return "input", "continuous", ""
    if variable.causality == "parameter":
        return "parameter", "tunable", "exact"
    variability = "discrete" if variable.integer else "continuous"
    return "output", variability, "exact" if variable.start is not None else "calculated"


def _structure(parent: ET.Element, model: FmuModel, is_2: bool) -> None:
    """Outputs, and those of them that initialisation computes."""
    outputs = [v for v in model.variables if v.causality == "output"]
    computed = [v for v in outputs if v.start is None]
    if not is_2:
        for name, group in (("Output", outputs), ("InitialUnknown", computed)):
            for variable in group:
                # The inputs act over the step that follows: none passes through at once.
                reference = {"valueReference": str(model.reference(variable))}
                ET.SubElement(parent, name, reference | {"dependencies": ""})
        return
    for name, group in (("Outputs", outputs), ("InitialUnknowns", computed)):
        if group:
            element = ET.SubElement(parent, name)
            for variable in group:
                place = 2 + model.variables.index(variable)  # after the time, counted from 1
                ET.SubElement(element, "Unknown", {"index": str(place), "dependencies": ""})


def _flag(value: bool) -> str:
    return "true" if value else "false"


def _bytes(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"
