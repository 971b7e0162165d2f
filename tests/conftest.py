"""FMUs that nobody of this project's code made: built by other tools, or by hand in C."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from tests.processor_time import Watch
from uuvsim_cosim.cache import cache_dir, content_hash
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host

# Hypothesis counts seconds on the clock, which other work on the machine takes as well.
hypothesis.settings.register_profile("uuvsim", deadline=None)
hypothesis.settings.load_profile("uuvsim")

# Servers of tests leave nothing in the user's own folder, also when they are killed.
TOKENS = tempfile.TemporaryDirectory(prefix="uuvsim-tokens-")
os.environ["UUVSIM_TOKENS"] = TOKENS.name

FOREIGN = Path(__file__).parent / "fmus" / "foreign"
FIRST_ORDER = {v: FOREIGN / f"first_order_fmi{v}.xml" for v in (1, 2, 3)}
SOURCES_LIST = (
    '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="{name}">'
    '<SourceFileSet language="C99"><SourceFile name="{file}"/></SourceFileSet>'
    "</BuildConfiguration></fmiBuildDescription>"
)
CFmu = Callable[..., Path]
SourceFmu = Callable[..., Path]
Start = Callable[..., "subprocess.Popen[Any]"]
Uuvsim = Callable[..., tuple[int, str, str]]
WATCH = Watch()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Limit the processor time of each test."""
    with WATCH.over(item.nodeid):
        return (yield)


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """Let Ctrl-C interrupt a test and what it starts, also in a shell's background job."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def start() -> Iterator[Start]:
    """Start processes, with the arguments of Popen, that end with the test at the latest."""
    with ExitStack() as stack:

        def started(command: Sequence[str | Path], **more: Any) -> subprocess.Popen[Any]:
            process = stack.enter_context(subprocess.Popen(command, **{"text": True, **more}))
            stack.callback(process.kill)
            return process

        yield started


def write_archive(path: Path, members: dict[str, bytes]) -> Path:
    """Write a zip whose bytes depend on the members alone."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return path


def forget(path: Path) -> None:
    """Take an archive of which there will never be another copy out of the user's cache."""
    if path.is_file():
        shutil.rmtree(cache_dir("archives") / content_hash([path.read_bytes()]), True)


@pytest.fixture
def uuvsim(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Uuvsim:
    """Run the command line in an empty folder: return its status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        from uuvsim_cosim.cli import status_of

        capsys.readouterr()
        status = status_of(list(arguments))
        said = capsys.readouterr()
        return status, said.out, said.err

    return call


@pytest.fixture(scope="session")
def c_fmu(tmp_path_factory: pytest.TempPathFactory) -> CFmu:
    """Build the hand-written first-order FMU: ``c_fmu(2)``, with edits of its description.

    Its bytes are the same in every test process, and so is its folder in the cache: it stays.
    """
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    folder = tmp_path_factory.mktemp("c_fmus")
    made: list[Path] = []

    def build(
        version: int, *, edits: Sequence[tuple[str, str]] = (), flags: Sequence[str] = ()
    ) -> Path:
        library = compile_shared(
            [FOREIGN / f"first_order_fmi{version}.c"],
            name=f"first_order_fmi{version}",
            include=[headers],
            flags=flags,
        )
        description = FIRST_ORDER[version].read_text()
        for old, new in edits:
            assert old in description
            description = description.replace(old, new)
        platform = host().fmi3 if version == 3 else host().fmi2
        members = {
            "modelDescription.xml": description.encode(),
            f"binaries/{platform}/first_order{host().suffix}": library.read_bytes(),
        }
        key = content_hash([str(version), description, *flags])[:8]
        path = folder / f"first_order_fmi{version}_{key}.fmu"
        if path not in made:
            made.append(write_archive(path, members))
        return path

    return build


def foreign_fmu(
    name: str,
    folder: Path,
    *,
    edits: Iterable[tuple[str, str]] = (),
    fault: int = 0,
    source: Path | None = None,
    xml: Path | None = None,
) -> Path:
    """Compile NAME_fmi3.c of tests/fmus/foreign, with edits of its description and a fault."""
    import fmpy

    include = [Path(fmpy.__file__).parent / "c-code"]
    source = source or FOREIGN / f"{name}_fmi3.c"
    library = compile_shared([source], name=name, include=include, flags=[f"-DFAULT={fault}"])
    text = (xml or source.with_suffix(".xml")).read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{name}_{content_hash([text, str(fault)])[:8]}.fmu"
    members = {
        "modelDescription.xml": text.encode(),
        f"binaries/{host().fmi3}/{name}{host().suffix}": library.read_bytes(),
    }
    return path if path.exists() else write_archive(path, members)


@pytest.fixture(scope="session")
def first_order_fmi2(c_fmu: CFmu) -> Path:
    """dy/dt = (k u - y) / T in C, FMI 2.0: all types, arrays v[3], w[3] = 2 v, m[2,2], faults."""
    return c_fmu(2)


@pytest.fixture(scope="session")
def first_order_fmi3(c_fmu: CFmu) -> Path:
    """dy/dt = (k u - y) / T in C, FMI 3.0: an echo of each type, arrays, faults."""
    return c_fmu(3)


@pytest.fixture(scope="session")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU in C, FMI 3.0, that does what a sandbox refuses, by its parameter `act`."""
    import fmpy

    include = [Path(fmpy.__file__).parent / "c-code"]
    library = compile_shared([FOREIGN / "hostile_fmi3.c"], name="hostile", include=include)
    members = {
        "modelDescription.xml": (FOREIGN / "hostile_fmi3.xml").read_bytes(),
        f"binaries/{host().fmi3}/hostile{host().suffix}": library.read_bytes(),
    }
    return write_archive(tmp_path_factory.mktemp("hostile") / "hostile.fmu", members)


@pytest.fixture(scope="session")
def source_fmu(tmp_path_factory: pytest.TempPathFactory) -> SourceFmu:
    """Pack a C file of tests/fmus/foreign as an FMU: ``source_fmu("ball_fmi2.c")``."""
    folder = tmp_path_factory.mktemp("source_fmus")

    def pack(file: str, name: str = "", xml: str = "", code: bytes = b"") -> Path:
        stem = file.removesuffix(".c")
        name = name or stem.rpartition("_")[0]
        description = (FOREIGN / (xml or f"{stem}.xml")).read_text()
        members = {f"sources/{file}": code or (FOREIGN / file).read_bytes()}
        members |= {f"sources/{h.name}": h.read_bytes() for h in FOREIGN.glob("*.h")}
        if 'fmiVersion="2.0"' in description:
            kind = "CoSimulation" if "<CoSimulation " in description else "ModelExchange"
            end = description.index("/>", description.index(f"<{kind} "))
            listed = f'><SourceFiles><File name="{file}"/></SourceFiles></{kind}>'
            description = description[:end] + listed + description[end + 2 :]
        else:
            build = SOURCES_LIST.format(name=name, file=file)
            members["sources/buildDescription.xml"] = build.encode()
        members["modelDescription.xml"] = description.encode()
        own = folder / (content_hash([code]) if code else "as_it_is")  # others keep their file
        own.mkdir(exist_ok=True)
        return write_archive(own / f"{stem}.fmu", members)

    return pack


@pytest.fixture(scope="session")
def runaway(source_fmu: SourceFmu) -> Path:
    """An FMU in plain C that does what a sandbox must survive, by its parameter `act`."""
    return source_fmu("runaway_fmi3.c", name="hostile", xml="hostile_fmi3.xml")


@pytest.fixture(scope="session")
def kinetics(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robertson's stiff kinetics in C, FMI 3.0: both interfaces, a structural parameter n.

    Its default experiment goes from 5 s to 1e6 s, without a step.
    """
    import fmpy

    include = [Path(fmpy.__file__).parent / "c-code"]
    library = compile_shared([FOREIGN / "kinetics_fmi3.c"], name="kinetics", include=include)
    members = {
        "modelDescription.xml": (FOREIGN / "kinetics_fmi3.xml").read_bytes(),
        f"binaries/{host().fmi3}/kinetics{host().suffix}": library.read_bytes(),
    }
    return write_archive(tmp_path_factory.mktemp("kinetics") / "kinetics.fmu", members)


def _built_by(tool: str, script: str, folder: Path) -> Path:
    """Build as a user does, on the command line of the tool."""
    arguments = ["build", "-f", str(FOREIGN / f"{script}.py"), "-d", str(folder)]
    done = subprocess.run(
        [sys.executable, "-m", tool, *arguments], capture_output=True, text=True, check=False
    )
    built = list(folder.glob("*.fmu"))
    assert built, done.stdout + done.stderr
    return built[0]


def _python_fmu(tool: str, script: str, factory: pytest.TempPathFactory) -> Iterator[Path]:
    path = _built_by(tool, script, factory.mktemp(tool))
    yield path
    forget(path)


@pytest.fixture(scope="session")
def pythonfmu2_controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A PID by pythonfmu: eta_d, nu_d, eta, nu -> tau_d as x[1] … x[6]; Kp, Ki, Kd; no units."""
    yield from _python_fmu("pythonfmu", "pid_fmi2", tmp_path_factory)


@pytest.fixture(scope="session")
def pythonfmu3_controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A PID by pythonfmu3: eta_d, nu_d, eta, nu -> tau_d of shape (6,); Kp, Ki, Kd; no units."""
    yield from _python_fmu("pythonfmu3", "pid_fmi3", tmp_path_factory)


@pytest.fixture(scope="session")
def pythonfmu2_lag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A first-order lag by pythonfmu: u -> y, parameters T and limit; logs each step."""
    yield from _python_fmu("pythonfmu", "lag_fmi2", tmp_path_factory)


@pytest.fixture(scope="session")
def pythonfmu3_lag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A first-order lag by pythonfmu3: u -> y, parameter T; logs each step."""
    yield from _python_fmu("pythonfmu3", "lag_fmi3", tmp_path_factory)
