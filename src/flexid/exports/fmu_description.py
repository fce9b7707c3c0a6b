"""``modelDescription.xml`` and ``buildDescription.xml`` of FMI 2.0 and 3.0."""

from typing import Any

import flexid
from flexid.exports.fmu_model import FmuModel, Variable
from flexid.exports.template import template_text

_TIME = Variable("time", "independent", None, "s", "simulated time")


def model_description(model: FmuModel, version: str) -> bytes:
    """The description of an FMU for co-simulation."""
    variables = [(_TIME, 0), *((v, model.reference(v)) for v in model.variables)]
    places = [(v, place, number) for place, (v, number) in enumerate(variables, 1)]
    outputs = [(place, number) for v, place, number in places if v.causality == "output"]
    computed = [(place, number) for v, place, number in places if v.initial == "calculated"]
    return _rendered(
        "fmu/modelDescription.xml",
        model=model,
        version=version,
        flexid_version=flexid.__version__,
        sources=sources(model, version),
        units=dict.fromkeys(v.unit for v in (*model.variables, _TIME) if v.unit),
        variables=variables,
        outputs=outputs,
        computed=computed,
    )


def build_description(model: FmuModel) -> bytes:
    """How an FMU of FMI 3.0 is compiled."""
    return _rendered("fmu/buildDescription.xml", model=model, sources=sources(model, "3.0"))


def sources(model: FmuModel, version: str) -> tuple[str, ...]:
    """Names of the files that are to be compiled."""
    own = (name for name in model.sources if name.endswith(".c"))
    return (f"fmi{version[0]}.c", *own)


def _rendered(name: str, **values: Any) -> bytes:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True
    )
    return environment.from_string(template_text(name)).render(values).encode()
