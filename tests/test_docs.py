"""What the README and the documentation say is true: examples run, commands and links exist."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import json
import posixpath
import re
import shlex
import tomllib
from functools import cache
from pathlib import Path
from types import ModuleType

import click
import pytest
import yaml

import bozzini
from benchmarks import claims, compare_peers, report
from bozzini.cli.common import OLD_OPTIONS, FieldOption, OldOption
from bozzini.cli.main import COMMANDS, root
from tests.fuzz.__main__ import find_commands

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")], key=lambda path: path.as_posix()
)
DOCS = sorted((ROOT / "docs").rglob("*.md"))
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.py"))
BLOCK = re.compile(r"^(?P<note><!-- not run: .+ -->\n+)?```python\n(?P<code>.*?)^```", re.M | re.S)
TEST = re.compile(r"`(test_\w+\.py)::(test_\w+)`")
LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)")


def _load_hook(name: str = "made_pages") -> ModuleType:
    path = ROOT / "docs" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


HOOK = _load_hook()


@cache
def _read(page: Path) -> str:
    """Return a page as `make docs` writes it, with all that is made, but for the commands."""
    text = page.read_text(encoding="utf-8")
    return text if page.parent.name == "reference" else HOOK.on_page_markdown(text)


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _examples(page: Path) -> list[str]:
    """Return the Python blocks of a page, except those marked ``<!-- not run: why -->``."""
    text = page.read_text(encoding="utf-8")  # what the gallery is made of has a test of its own
    return [match["code"] for match in BLOCK.finditer(text) if not match["note"]]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[] if page.parent == ROOT else pytest.mark.slow)
        for page in PAGES
        if _examples(page)
    ],
    ids=_name,
)
def test_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "example"}
    for number, code in enumerate(_examples(page), start=1):
        exec(compile(code, f"{_name(page)}, example {number}", "exec", dont_inherit=True), names)


def test_readme_has_an_example_of_five_lines() -> None:
    (code,) = _examples(ROOT / "README.md")
    assert sum(1 for line in code.splitlines() if line.strip()) == 5


def _command_lines(page: Path) -> list[str]:
    """Return the command lines of a page: indented ones, fenced ones, and those in the text."""
    text = _read(page).replace("\\\n", " ")
    indented = re.findall(r"^(?: {4}|\$ )?(bozzini [a-z].*)$", text, re.M)
    return indented + re.findall(r"`(bozzini [a-z][^`]*)`", text)


@pytest.mark.parametrize("page", [page for page in PAGES if _command_lines(page)], ids=_name)
def test_commands_and_their_options_exist(page: Path) -> None:
    for line in _command_lines(page):
        words = shlex.split(line, comments=True)[1:]
        command: click.Command = root
        for word in words:
            if not isinstance(command, click.Group) or word.startswith("-"):
                break
            found = command.get_command(click.Context(command), word)
            assert found is not None, f"{_name(page)}: {line}"
            command = found
        known = {"--help"}.union(*(o.opts + o.secondary_opts for o in command.params))
        flags = {word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert flags <= known, f"{_name(page)}: {line}"
        for option in command.params:
            for flag in set(option.opts) & set(words[:-1]):
                value = words[words.index(flag) + 1]
                if isinstance(option.type, click.Choice):
                    assert value in option.type.choices, f"{_name(page)}: {line}"


def test_options_that_pages_name_alone_exist() -> None:
    known = {"--help", "--debug", "--version", *OLD_OPTIONS}  # one page tells the old names
    for command in find_commands().values():
        known = known.union(*(option.opts + option.secondary_opts for option in command.params))
    for page in PAGES:
        if page.name == "CHANGELOG.md":  # it names what was removed
            continue
        code = " ".join(re.findall(r"`([^`\n]+)`", _read(page)))
        assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", code)) <= known, _name(page)


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(_read(page)):
        assert (page.parent / target).exists(), f"{_name(page)} links to {target}"


@pytest.mark.parametrize("page", [page for page in PAGES if TEST.search(_read(page))], ids=_name)
def test_tests_that_a_page_names_exist(page: Path) -> None:
    for file, name in TEST.findall(_read(page)):
        found = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob(file))
        assert f"\ndef {name}(" in found, f"{_name(page)}: {file}::{name}"


def test_every_hazard_of_the_rig_names_a_test() -> None:
    text = (ROOT / "docs" / "rig" / "safety.md").read_text(encoding="utf-8")
    table = text.partition("## Hazards")[2].partition("\n## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("|")][2:]
    assert len(rows) > 15
    assert not [row for row in rows if not TEST.search(row)]


def test_pages_of_the_documentation_are_in_its_menu() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")  # with a tag of mkdocs above the menu
    menu = yaml.safe_load(text.partition("\nnav:\n")[2])
    listed = []
    while menu:
        ((_, place),) = menu.pop().items()
        if isinstance(place, str):
            listed.append(place)
        else:
            menu += place
    tutorials = (ROOT / "docs" / "tutorials").glob("*.py")
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (*DOCS, *tutorials)}
    assert len(listed) == len(set(listed))
    assert set(listed) == pages


def test_the_front_page_links_every_page() -> None:
    linked = set(LINK.findall((ROOT / "docs" / "index.md").read_text(encoding="utf-8")))
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in DOCS}
    assert pages - {"index.md"} <= linked


@cache
def _slugs(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as mkdocs and hosts of repositories make them."""
    text = re.sub(r"^```.*?^```", "", HOOK.on_page_markdown(_read(page)), flags=re.M | re.S)
    plain = [
        re.sub(r"[`*]|\]\([^)]*\)|\[", "", head) for head in re.findall(r"^#+ (.+)$", text, re.M)
    ]
    slugs = {
        re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", head).strip().lower()) for head in plain
    }
    return slugs | set(re.findall(r'^<a id="([\w-]+)"></a>$', text, re.M))


@pytest.mark.parametrize("page", [*PAGES, *TUTORIALS], ids=_name)
def test_anchors_of_links_are_headings(page: Path) -> None:
    text = _read(page)
    for target, anchor in re.findall(r"\]\((?!https?://|mailto:)([^)#\s]*)#([^)\s]+)\)", text):
        other = (page.parent / target) if target else page
        if other.suffix == ".md" and "api" not in other.parts:
            assert anchor in _slugs(other), f"{_name(page)} links to {target}#{anchor}"


def test_the_reference_has_every_command_and_option() -> None:
    page = (ROOT / "docs" / "reference" / "cli.md").read_text(encoding="utf-8")
    made = HOOK.on_page_markdown(page)
    parts = re.split(r"^#+ bozzini (.+)\n", made, flags=re.M)
    told = dict(zip(parts[1::2], parts[2::2], strict=True))
    commands = find_commands()
    assert set(told) == set(commands) | {name.rpartition(" ")[0] for name in commands} - {""}
    for name, command in commands.items():
        for item in command.params:
            if isinstance(item, click.Option) and not isinstance(item, OldOption):
                by_name = isinstance(item, FieldOption)
                said = f"--set {item.name}=" if by_name else item.opts[0]
                assert f"- `{said}" in told[name], f"{name} {item.opts}"


def test_each_mark_is_filled_on_one_page() -> None:
    marks = [mark for page in DOCS for mark in HOOK.MARK.findall(page.read_text("utf-8"))]
    assert sorted(marks) == sorted(HOOK.MAKERS)
    assert not [page for page in DOCS if HOOK.MARK.search(_read(page)) and "cli" not in page.name]
    assert HOOK.on_page_markdown("another page") == "another page"


class _Source:
    """A page as mkdocs hands it to hooks, by its place among the sources."""

    def __init__(self, place: str) -> None:
        self.src_uri, self.file = place, self

    def url_relative_to(self, other: _Source) -> str:
        built = self.src_uri.rpartition(".")[0] + "/"
        return posixpath.relpath(built, other.src_uri.rpartition(".")[0]) + "/"

    @staticmethod
    def get_file_from_path(place: str) -> _Source | None:
        return _Source(place) if (ROOT / "docs" / place).exists() else None


@pytest.mark.parametrize("tutorial", TUTORIALS, ids=_name)
def test_links_of_a_tutorial_lead_to_built_pages(tutorial: Path) -> None:
    """They are written as links to sources, and mkdocs-jupyter leaves them as they are."""
    hook = _load_hook("links")
    page = _Source(f"tutorials/{tutorial.name}")
    for target in re.findall(r"\]\((?!https?://)([^)#]+)", tutorial.read_text("utf-8")):
        html = hook.on_page_content(f'<a href="{target}#x">', page=page, files=_Source)
        place = posixpath.normpath(f"tutorials/{tutorial.stem}/{html.split(chr(34))[1]}")
        source = ROOT / "docs" / place.removesuffix("/#x")
        assert any(source.with_name(source.name + end).exists() for end in (".md", ".py")), html


def test_a_build_names_links_that_lead_nowhere(tmp_path: Path) -> None:
    hook = _load_hook("links")
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    good = '<a href="../two/#here">, <a href="..">, <a href="https://a.b/c">, <img src="x.png">'
    bad = '<a href="../two/#there">, <a href="../three/">, <a href="../two.md">'
    (tmp_path / "index.html").write_text('<a href="one/">')
    (tmp_path / "one" / "x.png").touch()
    (tmp_path / "one" / "index.html").write_text(good + bad)
    (tmp_path / "two" / "index.html").write_text('<h1 id="here"></h1>')
    assert hook.find_broken(tmp_path) == [
        ("one/index.html", link) for link in ("../two/#there", "../three/", "../two.md")
    ]


GUIDE = [page for page in DOCS if page.parent.name == "guide"]


def test_every_guide_has_topics_for_the_search() -> None:
    hook = _load_hook("search")
    assert {f"guide/{page.name}" for page in GUIDE} <= set(hook.TOPICS)
    assert all((ROOT / "docs" / page).exists() for page in hook.TOPICS)
    assert hook.BOOSTS["guide"] > hook.BOOSTS["theory"] > hook.OTHERS > hook.BOOSTS["api"]


@pytest.mark.parametrize(
    ("folder", "most"), [("guide", 14_800), ("rig", 7_400), ("theory", 18_000), ("**", 60_000)]
)
def test_what_is_written_by_hand_is_short(folder: str, most: int) -> None:
    """Words, marks of tables too, of a folder of the documentation; of all, with the README."""
    pages = set((ROOT / "docs").glob(f"{folder}/*.md"))
    if folder == "**":
        pages |= {*DOCS, ROOT / "README.md"}
    assert len(pages) > 5
    words = sum(len(page.read_text("utf-8").split()) for page in pages)
    assert 0.8 * most < words <= most


@pytest.mark.parametrize("page", GUIDE, ids=_name)
def test_a_page_of_the_guide_leads_to_theory_and_ends_with_what_comes_next(page: Path) -> None:
    text = page.read_text("utf-8")
    head, last = text.partition("\n## ")[0], text.rstrip().splitlines()[-1]
    assert re.match(r"Next: \[", last), last
    assert re.search(r"\]\(\.\./(theory|rig|api|tutorials)/", head), head


SPELLINGS = {
    "centreline": r"center ?line|centre-?line\b(?<!centreline)",
    "workspace": r"work[ -]space",
    "backbone": r"back[ -]bone",
    "tendon": r"\bcables? robot|\bwire-driven",
    "phantom": r"\bfantom",
    "hysteresis": r"hysterisis",
    "end-effector": r"end ?effector",
    "set-point": r"\bset ?points?\b(?!\\_)",
    "feed-forward": r"feed ?forward",
    "dead band": r"dead-?band",
    "gauge pressure": r"gage pressure",
    "arc length": r"arclength",
    "tractrix": r"tractix",
    "follow the leader": r"follow-the-leader",
}
"""How the glossary does not spell its terms."""


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_terms_are_spelled_as_in_the_glossary(page: Path) -> None:
    if page.name in ("CHANGELOG.md", "coming-from.md"):  # these name others' terms
        return
    text = HOOK.on_page_markdown(_read(page))  # what the commands say of themselves, too
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    plain = re.sub(r"`[^`]*`|\]\([^)]*\)|\*[^*\n]+\*", "", text)
    for term, other in SPELLINGS.items():
        found = re.search(other, plain, re.I)
        assert found is None, f"{_name(page)}: '{found[0] if found else ''}' for {term}"


def test_the_glossary_has_the_terms() -> None:
    text = (ROOT / "docs" / "glossary.md").read_text("utf-8").lower()
    for term in SPELLINGS:
        assert re.search(rf"^\| ([^|]+, )?{term}", text, re.M), term


def test_every_package_has_a_page_of_its_names() -> None:
    packages = {path.parent.name for path in (ROOT / "src" / "bozzini").glob("*/__init__.py")}
    pages = {path.stem for path in (ROOT / "docs" / "api").glob("*.md")}
    assert packages - pages == {"cli", "io", "numeric"}
    assert {"checks", "errors", "progress", "registry", "results", "units"} <= pages


def test_table_of_commands_is_complete() -> None:
    text = _read(ROOT / "docs" / "cli.md")
    assert set(re.findall(r"^\| `bozzini ([a-z]+)", text, re.M)) == set(COMMANDS)


def test_each_job_has_its_command_and_calls_that_exist() -> None:
    page = _read(ROOT / "docs" / "want.md")
    listed = re.findall(r"^\| .+ \| \[`bozzini ([^`]+)`\]", page, re.M)
    assert sorted(listed) == sorted(find_commands())
    assert set(HOOK.CALLS) <= set(find_commands())
    for call in HOOK.CALLS.values():
        module, _, name = call.rpartition(".")
        assert hasattr(importlib.import_module(f"bozzini.{module}"), name), call


MEASURED = json.loads(report.MEASURED.read_text("utf-8"))


@pytest.mark.parametrize("name", report.PAGES)
def test_tables_and_sentences_about_speed_are_those_of_the_run(name: str) -> None:
    """`python -m benchmarks.report pages` writes them from what was measured."""
    page = (ROOT / name).read_text("utf-8")
    assert report.fill(name, page, MEASURED) == page


@pytest.mark.parametrize("name", ["README.md", "docs/trust.md", "docs/index.md"])
def test_no_sentence_about_speed_or_size_is_without_a_run(name: str) -> None:
    page = (ROOT / name).read_text("utf-8")
    for claim in report.CLAIMS:
        if claim.page == name:
            page = dataclasses.replace(claim, find=lambda _: "as measured").fill(page, MEASURED)
    page = re.sub(r"^(    .*|```.*?^```)$|`[^`]+`", "", page, flags=re.M | re.S)
    said = r"[\d.]+ (?:[nµum]?s|[KMG]i?B|seconds?|minutes?|times as)\b|\bminutes?\b"
    assert not re.findall(said, page)


def test_a_sentence_follows_the_run() -> None:
    """Another measurement changes what the README says, and a claim without a row is an error."""
    rows = [
        {**row, "measured": "7 ms"} if row["what"] == claims.PLAN else row
        for row in MEASURED["rows"]
    ]
    readme = (ROOT / "README.md").read_text("utf-8")
    filled = report.fill("README.md", readme, {**MEASURED, "rows": rows})
    assert "through a human upper tract | 7 ms |" in filled
    with pytest.raises(ValueError, match="0 times"):
        report.fill("README.md", "nothing of it", MEASURED)


def test_a_run_takes_the_place_of_its_own_rows() -> None:
    old = [{"test": "a", "what": "A", "kept": True}, {"test": "b", "what": "B", "kept": True}]
    new = [{"test": "a", "kept": False}, {"test": "c", "what": "C", "measured": "1", "kept": False}]
    rows = report.merge(old, new)
    assert [row["what"] for row in rows] == ["B", "C"]  # A failed before it had measured
    assert "Bounds that were not kept: C." in report.list_table(
        [{"measured": "", "machine": "one", **row} for row in rows]
    )


def test_what_is_said_of_peers_is_what_was_measured() -> None:
    seconds = {"Bozzini rod": 2.0, "Bozzini energy": 1.0, "SoRoMoX": 5.0, "PyElastica": 80.0}
    records = [
        {"case": "one", "tool": tool, "pieces": 6, "miss_mm": 0.01, "seconds": took}
        for tool, took in seconds.items()
    ]
    records.append({**records[0], "case": "two"})
    records.append({"case": "two", "tool": "PyElastica", "missing": "elastica"})
    lines = "\n".join(compare_peers.format_peers({"day": "", "versions": {}, "records": records}))
    assert "SoRoMoX takes 2.5 to 2.5 times as long as `rod`" in lines
    assert "`energy` takes 0.20 to 0.20 times as long as SoRoMoX" in lines
    assert "| two | PyElastica | – | – | not run: no package `elastica` | – |" in lines


def test_the_page_of_benchmarks_is_short_and_of_the_long_one() -> None:
    def rows(name: str) -> list[list[str]]:
        lines = re.findall(r"^\| (.+) \|$", _read(ROOT / "docs" / name), re.M)
        return [line.split(" | ") for line in lines]

    every = {row[0]: row[1] for row in rows("benchmarks-all.md")}
    short = rows("benchmarks.md")[1:]
    assert 10 <= len(short) <= 15
    assert all(every[what] == measured for _, what, measured in short)


def test_errors_on_the_trust_page_are_those_of_the_validation() -> None:
    trust, validation = (
        (ROOT / "docs" / f"{n}.md").read_text("utf-8") for n in ("trust", "validation")
    )
    rows = re.findall(r"^\| .+ \| ([^|]+) \| `make validate SET=(\w+)` \|$", trust, re.M)
    assert {name for _, name in rows} == set(re.findall(r"<!-- (\w+): begin -->", validation))
    for error, name in rows:
        section = validation.partition(f"<!-- {name}: begin -->")[2].partition(f"<!-- {name}: end")[
            0
        ]
        numbers = re.findall(r"(\d[\d.]*)(?= (?:to|mm|N|%))", error)
        assert numbers
        for number in numbers:
            found = re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", section)
            assert found, f"{name}: {number} of '{error}'"


def test_the_files_of_a_plan_are_listed() -> None:
    text = (ROOT / "docs" / "files.md").read_text("utf-8").partition("## The plan file")[0]
    record = json.loads((ROOT / "tests" / "cli" / "recorded_commands.json").read_text("utf-8"))
    runs = [run for line, run in record.items() if line.split()[0] in ("plan", "demo")]
    names = {Path(path).name for run in runs for path in run.get("files", ())}
    assert len(names) > 8
    plain = {re.sub(r"plan-[a-z]+", "plan-METHOD", name) for name in names}
    assert plain <= set(re.findall(r"`([\w.-]+)`", text))


def test_one_version_everywhere() -> None:
    version = bozzini.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## [{version}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_declared_dependencies_are_those_imported() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[<>=\[ ]", item)[0] for item in project["dependencies"]}
    modules = {"libigl": "igl", "PyYAML": "yaml"}
    for name in declared:
        modules.setdefault(name, name.replace("-", "_"))
        importlib.import_module(modules[name])
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    used = {
        name
        for name in declared
        if re.search(rf"^\s*(import|from) {modules[name]}\b", source, re.M)
    }
    assert used == declared
