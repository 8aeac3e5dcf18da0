"""What README and the model card say is what the code does."""

import re
from pathlib import Path

import pytest

from endolock.scripts import docs
from endolock.twin import generate

ROOT = Path(__file__).parents[1]


def test_the_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    exec(compile(example, "README.md", "exec"), {})
    assert 0 < float(capsys.readouterr().out) < 640  # an error within the picture


@pytest.mark.parametrize("law", ["pi", "ik"])
def test_the_readme_shows_the_measured_table(law: str) -> None:
    measured = _row(ROOT / "docs/results.md", f"| straight | {law}")
    shown = _row(ROOT / "README.md", f"| straight | {law}")
    assert shown == ["0.40", *measured[:4], measured[-1]]  # the latency, and no error of vision


def _row(document: Path, start: str) -> list[str]:
    """Figures of the first table row that starts so; rows of runs without pictures come later."""
    row, *_ = [line for line in document.read_text().splitlines() if line.startswith(start)]
    return re.findall(r"\d+\.\d+", row)


def test_links_in_documents_lead_somewhere() -> None:
    for document in (ROOT / "README.md", ROOT / "CONTRIBUTING.md"):
        for link in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
            assert (document.parent / link).exists(), link


def test_the_model_card_lists_the_defaults() -> None:
    assert docs.parameters() in (generate.folder() / "README.md").read_text()


def test_the_schema_for_editors_is_that_of_the_code() -> None:
    place = generate.folder().parent / "scenarios"
    assert (place / "schema.json").read_text() == docs.schema()
    for file in place.glob("*.toml"):
        assert file.read_text().startswith("#:schema schema.json\n")  # what editors look for
