"""What each command is beside the function of the library that it calls: examples, words, ends."""

from flexid.cli.generated import Command

_PARTICULAR = "flexid.cli.particular"

COMMANDS = (
    Command(
        "identify",
        (
            "identify examples/flexible_joint.csv --out results",
            "identify run1.csv run2.csv --known motor_inertia=0.3+-0.01",
            "identify arm.csv --columns map.toml --bounds joint_stiffness=50:200",
            "identify day.parquet --stream --strict",
            "identify run.csv --model arm.toml",
        ),
        "0 where every parameter is determined or weak; 1 where one is not determined, and the "
        "answer says which and why; with --strict, 1 where one is weak, too; 2 for bad input.",
        doing="identifying",
        writes="report.html, estimate.json and the figures",
        flags=("explain", "strict"),
        notes="A planar arm of several elastic joints is described by a TOML file after --model, "
        "and its channels are numbered.",
        more="--explain",
        done=lambda answer, flags: answer.supports(strict=flags["strict"]),
        run=_PARTICULAR,
    ),
    Command(
        "validate",
        (
            "validate results/estimate.json run3.csv --out results",
            "validate results run3.csv --min-fit 80",
        ),
        "0 when it is done; 1 where the free run is below --min-fit; 2 for bad input.",
        doing="predicting",
        writes="report.html, validation.json and the figures",
        flags=("min_fit",),
        more="--json",
        done=lambda answer, flags: answer.supports(flags["min_fit"]),
    ),
    Command(
        "compare",
        (
            "compare before/estimate.json after/estimate.json",
            "compare drive1 drive2 --out differences",
            "compare before after --json",
        ),
        "0 where everything was compared and no change is seen; 1 where something has changed, or "
        "is not determined in both, and the answer says what; 2 for bad input.",
        writes="comparison.json, comparison.png and report.html",
        done=lambda answer, _flags: answer.agree,
    ),
    Command(
        "excitation",
        (
            "excitation examples/flexible_joint.csv",
            "excitation run1.csv --known motor_inertia=0.3 --out results",
        ),
        "as for flexid identify.",
        doing="examining",
        writes="excitation.json and excitation.png",
        flags=("strict",),
        more="flexid identify --explain",
        done=lambda answer, flags: answer.supports(strict=flags["strict"]),
    ),
    Command(
        "design",
        (
            "design examples/drive.toml --out results",
            "design examples/drive.toml --kind trajectory --duration 20",
        ),
        "0 where every coefficient would be determined to 10 % or better; 1 where some would not, "
        "and the answer says which; 2 for bad input.",
        doing="searching",
        writes="command.csv, design.json and design.png",
        done=lambda answer, _flags: answer.supported,
    ),
    Command(
        "derive",
        (
            "derive flexible-joint --to latex",
            "derive examples/models/pendulum.toml --to c",
        ),
        "0 when it is done, 2 for bad input, which includes a model that has no observer.",
        run=_PARTICULAR,
    ),
    Command(
        "export",
        (
            "export results/estimate.json --to c99 --sample-time 0.001 --out drive",
            "export flexible-joint --to c99 --log run.csv --out drive",
            "export results/estimate.json --to mjcf --out scene",
            "export results/estimate.json --to fmu --sample-time 0.001 --out units",
        ),
        "0 when it is done, 2 for bad input.",
        doing="exporting",
        run=_PARTICULAR,
    ),
    Command(
        "watch",
        (
            "watch examples/flexible_joint.csv --stop-at-end",
            "watch run.csv --checkpoint run.checkpoint",
            "watch udp://127.0.0.1:9000 --json",
            "watch run.csv --estimate results/estimate.json --memory 60",
            "watch 'serial:///dev/ttyUSB0?baud=921600' --columns drive.toml",
        ),
        "0 where the estimates had converged in the end, 1 where they had not, 2 for bad input, "
        "3 for Ctrl-C; the last report and the checkpoint are written in any case.",
        writes="watch.json, the last report,",
        notes="In a terminal the view is renewed; with --json each report is one line.",
        run="flexid.cli.watch",
    ),
    Command(
        "studio",
        (
            "studio",
            "studio examples/flexible_joint.csv",
            "studio --port 9000 --no-browser",
        ),
        "3 when Ctrl-C ends it, 2 where it cannot listen, or LOG is not there.",
        own="flexid.cli.studio",
    ),
    Command(
        "simulate",
        (
            "simulate experiments/sampled_joint.toml --out run",
            "simulate experiments/huang2003.toml --set controller.k=30",
        ),
        "0 when the run is done; 1 where it diverges or cannot meet its tolerance; 2 for bad "
        "input.",
        doing="simulating",
        writes="report.html, run.json, run.parquet, log.parquet, figures",
        flags=("csv",),
        run=_PARTICULAR,
    ),
    Command(
        "campaign",
        (
            "campaign experiments/noise_campaign.toml --out noise",
            "campaign --summary noise",
        ),
        "0 where every run has its row, however it ended; 1 for a summary in which no run "
        "finished; 2 for bad input; 3 where it was interrupted, with all complete parts kept.",
        done=lambda answer, _flags: bool(answer.result.finished),
        run=_PARTICULAR,
    ),
    Command(
        "reproduce",
        ("reproduce --out results",),
        "0 when it is done; 2 for bad input.",
        doing="reproducing",
        writes="report.html, result.json and the figures",
    ),
)
"""The commands, each of which calls the function of its name in the library, or declares itself."""
