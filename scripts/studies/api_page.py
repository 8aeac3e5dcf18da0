"""docs/api.md: the public names of endolock, each with the first sentence of its docstring."""

from __future__ import annotations

import inspect

import endolock

GROUPS = {
    "Rigs": ("TwinRig", "HilRig", "SurrogateRig", "SerialRig", "Rig"),
    "Worlds": ("Scenario", "load_scenario", "Instrument", "load_instrument"),
    "Eyes": ("MarkerEyes", "TrackEyes", "TruthEyes", "Eyes", "Frame", "Observation", "Status"),
    "Controllers": ("Controller", "Command", "State", "Calibration"),
    "Runs": ("Experiment", "run", "score", "Scores", "RunRecord", "read_run", "Interrupted"),
    "Errors": (
        "EndolockError",
        "ConfigError",
        "HardwareError",
        "StateError",
        "CommandError",
        "LinkError",
        "PortBusy",
        "PortGone",
        "LinkLost",
        "DeviceFault",
        "DamageWarning",
    ),
}
"""All of `endolock.__all__` but `__version__`, as users look for it."""
HEAD = """# Python interface

Written by `./run docs` from `endolock.__all__`. `import endolock` is quick: each name is loaded
when it is first used. Names that are not listed here may move between versions.

```python
from endolock import Experiment, read_run

record = Experiment(scenario="straight", controller="pi", vision="truth", duration_s=5.0).run()
print(record.error_px.rms, read_run(record.folder).ticks.num_rows)
```

`Experiment` takes names, files or objects, and writes a run folder. `run` takes a rig, eyes and a
controller and keeps everything in memory. `endolock.__version__` is the version of the package.
"""


def page() -> str:
    """Lay out docs/api.md."""
    parts = [HEAD]
    for title, names in GROUPS.items():
        parts.append(f"\n## {title}\n\n| name | | defined in |\n| --- | --- | --- |\n")
        for name in names:
            module = endolock.HOMES[name].partition(":")[0]
            path = module.replace(".", "/") + ".py"
            parts.append(f"| `{name}` | {summary(name)} | [{path}](../{path}) |\n")
    return "".join(parts)


def summary(name: str) -> str:
    """Return the first sentence of a public name's docstring, in one line."""
    text = inspect.getdoc(getattr(endolock, name)) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("|", "\\|")
