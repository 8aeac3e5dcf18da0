"""README, CONTRIBUTING and the model card agree with the code and with the measured pages."""

import re
from pathlib import Path

import pytest

import endolock
from endolock.control import registry
from endolock.scripts import demo
from endolock.scripts.studies import api_page, docs
from endolock.twin.model import generate

ROOT = Path(__file__).parents[1]
NOT_SIMPLE = {"predictive", "predictive_bank", "oracle", "repetitive"}
"""These identify the transmission, know it, or know the period."""


def test_the_python_examples_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL):
        exec(compile(block, "README.md", "exec"), names)
    first, second = capsys.readouterr().out.splitlines()
    assert 0 < float(first) < 640  # an error within the picture
    error, folder = second.split()
    assert float(error) == pytest.approx(float(first))  # the same run, in memory and in a folder
    assert (tmp_path / folder / "metrics.json").exists()


def test_the_python_example_uses_public_names_alone() -> None:
    (first, *_) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    for line in re.findall(r"^(?:from|import) .*$", first, re.MULTILINE):
        _, _, listed = line.partition("from endolock import ")
        assert set(listed.split(", ")) <= set(endolock.__all__), line


def test_the_api_page_lists_the_public_names() -> None:
    assert (ROOT / "docs/api.md").read_text() == api_page.page()
    listed = [name for names in api_page.GROUPS.values() for name in names]
    assert sorted([*listed, "__version__"]) == sorted(endolock.__all__)


@pytest.mark.parametrize("law", [*demo.LAWS, "constant"])
def test_the_readme_shows_the_measured_table(law: str) -> None:
    measured = _row(ROOT / "docs/results.md", f"| straight | {law}")
    shown = _row(ROOT / "README.md", f"| straight | {law}")
    assert shown == [*measured[:6], *measured[7:]]  # without the error of vision


def test_the_readme_quotes_the_benchmark() -> None:
    text = " ".join((ROOT / "README.md").read_text().split())
    promised = re.search(
        r"On `straight` it is at ([\d.]+) px, .* `(\w+)`, at ([\d.]+) px and the best constant "
        r"handle at ([\d.]+) px; on `circle` at ([\d.]+) px against ([\d.]+) \(`(\w+)`\) and "
        r"([\d.]+) px",
        text,
    )
    assert promised
    page = ROOT / "docs/benchmark.md"
    head = _row(page, "| scenario")
    simple = [name for name in registry.LAWS if name not in NOT_SIMPLE]
    measured = []
    for name in ("straight", "circle"):
        row = dict(zip(head, _row(page, f"| {name} |"), strict=True))
        rms = {law: float(row[law].split()[0]) for law in simple}  # (lost ... %) may follow
        least = min(simple, key=rms.__getitem__)
        own, best = (row[law].split()[0] for law in ("predictive_bank", least))
        measured.append((own, least, best, row["constant"]))
    own, law, best, constant, *on_circle = promised.groups()
    assert (own, law, best, constant) == measured[0]
    own, best, law, constant = on_circle
    assert (own, law, best, constant) == measured[1]


def _row(document: Path, start: str) -> list[str]:
    """Cells of the first table row with this start; rows of runs without pictures come later."""
    row, *_ = [line for line in document.read_text().splitlines() if line.startswith(start)]
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_links_in_documents_work() -> None:
    for document in (ROOT / "README.md", ROOT / "CONTRIBUTING.md"):
        for link in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
            assert (document.parent / link).exists(), link


def test_the_model_card_lists_the_defaults() -> None:
    assert docs.parameters() in (generate.folder() / "README.md").read_text()


def test_the_schema_for_editors_is_made_from_the_code() -> None:
    folder = generate.folder().parent / "scenarios"
    assert (folder / "schema.json").read_text() == docs.schema()
    for file in folder.glob("*.toml"):
        assert file.read_text().startswith("#:schema schema.json\n")  # what editors look for


def test_the_readme_claims_no_more_of_vision_than_was_measured() -> None:
    text = " ".join((ROOT / "README.md").read_text().split())
    promised = re.search(r"target to ([\d.]+) px rms and its depth to ([\d.]+) %", text)
    worst = re.search(r"no position more than ([\d.]+) px off", text)
    assert promised
    assert worst
    page = (ROOT / "docs/vision.md").read_text()
    rows = re.findall(r"^\| \d+ mm \|(.*)\|$", page, re.MULTILINE)
    cells = [[float(c.strip(" %")) for c in row.split("|")] for row in rows]
    assert len(cells) > 5
    assert max(c for row in cells for c in row[0::4]) <= float(promised[1])
    assert max(c for row in cells for c in row[2::4]) <= float(promised[2])
    assert re.search(r"\| of these accepted \| 0 \|", page)
    largest = re.search(r"largest error of an accepted frame \| ([\d.]+) px", page)
    assert largest
    assert float(largest[1]) <= float(worst[1])
