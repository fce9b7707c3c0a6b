"""The target ``c99``: an estimator for a drive as C99, with an example and a test vector."""

from pathlib import Path
from typing import TYPE_CHECKING

from flexid.derivation.drive_source import comment
from flexid.estimators.parametric_observer import ParametricObserver
from flexid.exports.c99_source import DriveSource
from flexid.exports.c99_vector import log_samples, made_samples, vector_text
from flexid.exports.template import filled, template_text

if TYPE_CHECKING:
    from flexid.exports.targets import ExportRequest


def write_c99(request: "ExportRequest", directory: Path) -> tuple[str, ...]:
    """Write the files of an estimator."""
    assert request.settings is not None  # export_to has seen to it
    drive = DriveSource(request.source, request.settings)
    samples = request.samples
    vector = made_samples(drive) if samples is None else log_samples(drive, samples)
    files = {
        "flexid_drive.h": drive.header(),
        "flexid_drive.c": drive.source(),
        "example_main.c": _example(drive),
        "test_vector.h": vector_text(drive, vector),
        "README.md": _readme(drive),
    }
    for name, text in files.items():
        (directory / name).write_text(text, encoding="utf-8")
    return ()


def _example(drive: DriveSource) -> str:
    coefficients = drive.system.coefficients
    names = [drive.names[name] for name in coefficients]
    last = len(names) - 1
    return filled(
        "c99/example_main.c",
        found="\n".join(
            f"        (double)values.{name}{',' if i < last else ''}"
            for i, name in enumerate(names)
        ).replace("values.", "values->"),
        prints="\n".join(
            f'    (void)printf("{name} = %.6g\\n", (double)values.{name});' for name in names
        ),
    )


def _readme(drive: DriveSource) -> str:
    system, settings = drive.system, drive.settings
    constant = isinstance(drive.twin, ParametricObserver)
    return filled(
        "c99/README.md",
        model=comment(system.name),
        summary=settings.summary,
        sample_time=f"{settings.sample_time:g}",
        hold={"zero": "are held until the next", "linear": "run on straight lines"}[settings.hold],
        sample=", ".join(f"`{drive.names[name]}`" for name in drive.sample_names),
        coefficients=", ".join(f"`{drive.names[name]}`" for name in system.coefficients),
        converged=template_text(
            "c99/converged_constant.md" if constant else "c99/converged.md"
        ).strip(),
    )
