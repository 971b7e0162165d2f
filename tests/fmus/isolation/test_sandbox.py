"""An isolated FMU reads its own files and those of the system; each refusal names its grant."""

from __future__ import annotations

import errno
import json
import socket
import subprocess
import sys
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.isolation.grants import Grants, size_text
from uuvsim_cosim.fmus.isolation.isolated import Isolated

if sys.platform != "linux":
    pytest.skip("the sandbox is Linux's", allow_module_level=True)


class Act(IntEnum):
    """As in hostile_fmi3.c."""

    NOTHING, READ_KEY, TCP, UDP, FORKS, ALLOCATES, EXECS, GROWS, WRITES, TRACES = range(10)
    CHANGES_MODE, KILLS, RAISES_LIMIT, STARTS_THREAD, ANSWERS, SHRINKS = range(10, 16)
    READS, DELETES, CONNECTS, FORKS_ONCE = range(16, 20)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home folder with a key; the cache stays where it is."""
    monkeypatch.setenv("UUVSIM_CACHE", str(cache_dir()))
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh" / "id").write_text("secret")
    return tmp_path


def made(
    fmu: Path, act: Act, path: object = "", grants: Sequence[str] = (), **more: Any
) -> Isolated:
    component = instantiate_fmu(fmu, "bad", isolate=True, watchdog=30.0, grants=grants)
    assert isinstance(component, Isolated)
    variables = component.description.variables
    for name, value in {"act": int(act), "path": str(path), **more}.items():
        component.set(variables[name], value)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    return component


def done(
    fmu: Path, act: Act, path: object = "", grants: Sequence[str] = ()
) -> tuple[int, list[str]]:
    """Return what the FMU got, and the notes."""
    component = made(fmu, act, path, grants)
    try:
        for k in range(3):
            component.do_step(k * 0.1, 0.1)
        return component.get(component.description.variables["got"]), [
            t for _, t in component.messages
        ]
    finally:
        component.free()


REFUSED = [
    (Act.READ_KEY, "it tried to read {home}/.ssh/id", "read:{home}/.ssh/id"),
    (Act.READS, "it tried to read {home}/there", "read:{home}/there"),
    (Act.WRITES, "it tried to write {home}/there", "files:{home}/there"),
    (Act.DELETES, "it tried to change (unlink) {home}/there", "files:{home}/there"),
    (Act.CHANGES_MODE, "it tried to change attributes of {home}/there (chmod)", "all"),
    (Act.TCP, "it tried to open a socket (TCP)", "network"),
    (Act.UDP, "it tried to open a socket (UDP)", "network"),
    (Act.FORKS_ONCE, "it tried to start a process", "processes"),
    (Act.EXECS, "it tried to start the program /bin/sh", "processes"),
    (Act.TRACES, "it tried to call ptrace()", "all"),
    (Act.RAISES_LIMIT, "it tried to change its limits (prlimit64)", "all"),
]


@pytest.mark.parametrize(("act", "what", "grant"), REFUSED, ids=[a.name for a, *_ in REFUSED])
def test_a_refused_access_is_named_once_with_its_grant(
    act: Act, what: str, grant: str, hostile: Path, home: Path
) -> None:
    (home / "there").write_text("x")
    got, notes = done(hostile, act, home / "there")
    assert got == -errno.EACCES
    expected = f"{what}, which its sandbox refuses; --grant bad={grant} allows it"
    assert notes == [expected.format(home=home)]
    assert (home / "there").stat().st_mode & 0o777 != 0o777


def test_a_new_file_is_refused_with_the_grant_of_its_folder(hostile: Path, home: Path) -> None:
    got, (note,) = done(hostile, Act.WRITES, home / "new")
    assert got == -errno.EACCES
    assert f"to write {home}/new, " in note
    assert f"bad=files:{home} " in note


def test_a_file_that_does_not_exist_is_no_refusal(hostile: Path, home: Path) -> None:
    assert done(hostile, Act.READS, home / "absent") == (-errno.ENOENT, [])


def test_a_signal_to_another_process_is_refused(hostile: Path) -> None:
    got, (note,) = done(hostile, Act.KILLS)
    assert got == -errno.EACCES
    assert "it tried to send a signal to process" in note


@pytest.mark.parametrize("act", [Act.ALLOCATES, Act.GROWS])
def test_memory_over_the_limit_is_refused_and_the_amount_is_named(act: Act, hostile: Path) -> None:
    got, (note,) = done(hostile, act)
    assert got == -errno.ENOMEM
    asked = {
        Act.ALLOCATES: "it asked for 100.01 GiB of memory at once",
        Act.GROWS: "it asked for 128.01 MiB",
    }
    assert note.startswith(asked[act])
    assert "and may have 4 GiB" in note
    granted = {Act.ALLOCATES: "bad=memory:101GiB", Act.GROWS: "bad=memory:5GiB"}
    assert granted[act] in note


def test_memory_that_the_machine_has_is_refused_too(hostile: Path) -> None:
    got, (note,) = done(hostile, Act.ALLOCATES, "6")  # GiB; the machine itself refuses 100
    assert (got, "it asked for 6.01 GiB of memory" in note) == (-errno.ENOMEM, True)


def test_a_well_behaved_fmu_gives_the_same_bits_without_a_note(first_order_fmi3: Path) -> None:
    results = []
    for isolate in (False, True):
        component = instantiate_fmu(first_order_fmi3, "plant", isolate=isolate)
        v = component.description.variables
        component.set(v["u"], 1.0)
        component.enter_initialization_mode(0.0, None)
        component.exit_initialization_mode()
        for k in range(50):
            component.do_step(k * 0.1, 0.1)
        results.append(component.get(v["y"]))
        assert not getattr(component, "messages", [])
        assert not getattr(component, "lacking", [])
        component.free()
    assert results[0] == results[1]


def test_threads_are_allowed(hostile: Path) -> None:
    assert done(hostile, Act.STARTS_THREAD) == (1, [])


def test_a_python_fmu_runs_in_the_sandbox(pythonfmu3_controller: Path) -> None:
    """It makes an identifier when it starts, for which the C library asks for sockets."""
    component = instantiate_fmu(pythonfmu3_controller, "pid", isolate=True)
    assert isinstance(component, Isolated)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    component.do_step(0.0, 0.1)
    notes = [text for level, text in component.messages if level == "note"]
    assert all(text.startswith("it tried to open a socket") for text in notes)
    component.free()


# ---- grants -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("act", "grant"),
    [
        (Act.READ_KEY, "read:{home}/.ssh"),
        (Act.READ_KEY, "files:{home}"),
        (Act.WRITES, "files:{home}"),
        (Act.DELETES, "files:{home}"),
        (Act.TCP, "network"),
        (Act.UDP, "network"),
        (Act.TCP, "tcp:5000"),
        (Act.FORKS_ONCE, "processes"),
        (Act.ALLOCATES, "memory:8GiB"),
        (Act.CHANGES_MODE, "all"),
    ],
)
def test_a_grant_permits_the_access(act: Act, grant: str, hostile: Path, home: Path) -> None:
    (home / "there").write_text("x")
    path = "6" if act == Act.ALLOCATES else home / "there"  # GiB, more than without the grant
    assert done(hostile, act, path, [grant.format(home=home)]) == (1, [])


@pytest.mark.parametrize("act", [Act.WRITES, Act.DELETES])
def test_a_grant_to_read_does_not_permit_a_change(act: Act, hostile: Path, home: Path) -> None:
    (home / "there").write_text("x")
    got, (note,) = done(hostile, act, home / "there", [f"read:{home}"])
    assert got == -errno.EACCES
    assert "bad=files:" in note
    assert (home / "there").read_text() == "x"


def test_a_port_of_tcp_is_granted_without_other_ports_and_udp(hostile: Path) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as one,
        socket.create_server(("127.0.0.1", 0)) as two,
    ):
        granted, other = (s.getsockname()[1] for s in (one, two))
        grants = [f"tcp:{granted}"]
        assert done(hostile, Act.CONNECTS, granted, grants) == (1, [])
        assert done(hostile, Act.CONNECTS, other, grants)[0] == -errno.EACCES
    assert done(hostile, Act.UDP, "", grants)[0] == -errno.EACCES


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("file:/data", r"grants: 'file:/data' was read; expected read:PATH, files:PATH"),
        ("read:/no/such/folder", "there is no /no/such/folder; expected a file or folder"),
        ("tcp:0", "'tcp:0' was read"),
        ("tcp:70000", "'tcp:70000' was read"),
        (
            "memory:8",
            "'memory:8' was read; expected a size with a unit, memory:8MiB or memory:8GiB",
        ),
        ("network:80", "'network:80' was read"),
    ],
)
def test_a_wrong_grant_is_refused(text: str, expected: str) -> None:
    with pytest.raises(InputInvalid, match=expected):
        Grants.of([text])


def test_grants_add_up() -> None:
    read = Grants.of(["read:/usr", "read:/etc", "memory:1.5GiB"])
    assert (read.read, read.memory) == (("/usr", "/etc"), 3 << 29)
    assert [size_text(n) for n in (100, (5 << 20) + 1, 94 << 30)] == [
        "100 bytes",
        "5.01 MiB",
        "94 GiB",
    ]


# ---- the parent -------------------------------------------------------------------------------


def test_an_fmu_that_writes_into_the_pipe_runs_no_code_in_the_parent(
    hostile: Path, home: Path
) -> None:
    component = made(hostile, Act.ANSWERS, home / "touched")
    component.do_step(0.0, 0.1)
    with pytest.raises((ComponentFailed, FmuError), match="sent what is no answer"):
        component.do_step(0.1, 0.1)
    assert not (home / "touched").exists()
    assert component.process is None


# ---- a kernel without a feature -----------------------------------------------------------------

KERNEL = """
import json, sys
from pathlib import Path
from uuvsim_cosim.fmus.isolation import seccomp
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
fmu, act, path, program = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3], json.loads(sys.argv[4])
component = instantiate_fmu(fmu, "bad")  # compiles
component.free()
seccomp.install([tuple(i) for i in program], notify=False)
component = instantiate_fmu(fmu, "bad", isolate=True)
v = component.description.variables
component.set(v["act"], act)
component.set(v["path"], path)
component.enter_initialization_mode(0.0, None)
component.exit_initialization_mode()
for k in range(3):
    component.do_step(k * 0.1, 0.1)
print(json.dumps([component.get(v["got"]), component.lacking, component.messages]))
component.free()
"""
LOAD, EQUAL, ANY_BIT, RETURN, ALLOW, ERROR = 0x20, 0x15, 0x45, 0x06, 0x7FFF0000, 0x50000


@pytest.fixture
def on_kernel(hostile: Path, home: Path) -> Any:
    """Run the FMU where some system calls return an error, as an older kernel's do."""

    def call(program: list[tuple[int, int, int, int]], act: Act) -> Any:
        (home / "there").write_text("x")
        arguments = [str(hostile), str(int(act)), str(home / "there"), json.dumps(program)]
        ended = subprocess.run(
            [sys.executable, "-c", KERNEL, *arguments], capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return call


def without(number: int) -> list[tuple[int, int, int, int]]:
    error = (RETURN, 0, 0, ERROR | errno.ENOSYS)
    return [(LOAD, 0, 0, 0), (EQUAL, 0, 1, number), error, (RETURN, 0, 0, ALLOW)]


def without_notification() -> list[tuple[int, int, int, int]]:
    from uuvsim_cosim.fmus.isolation.seccomp import _SECCOMP

    return [
        (LOAD, 0, 0, 0), (EQUAL, 0, 3, _SECCOMP), (LOAD, 0, 0, 24), (ANY_BIT, 0, 1, 8),
        (RETURN, 0, 0, ERROR | errno.EINVAL), (RETURN, 0, 0, ALLOW),
    ]  # fmt: skip


def test_without_landlock_one_sentence_says_that_files_are_not_protected(on_kernel: Any) -> None:
    got, lacking, _ = on_kernel(without(444), Act.READS)
    assert (got, lacking) == (1, ["this kernel has no Landlock: files are not protected"])
    got, _, notes = on_kernel(without(444), Act.TCP)
    assert got == -errno.EACCES
    assert len(notes) == 1


def test_without_notification_accesses_are_refused_without_a_name(on_kernel: Any) -> None:
    sentence = "seccomp cannot notify (Invalid argument): refused accesses are not named"
    for act in (Act.READS, Act.TCP, Act.EXECS, Act.FORKS_ONCE):
        assert on_kernel(without_notification(), act) == [-errno.EACCES, [sentence], []]
    assert on_kernel(without_notification(), Act.ALLOCATES)[0] == -errno.ENOMEM


def test_without_seccomp_sentences_say_what_is_not_refused(on_kernel: Any) -> None:
    from uuvsim_cosim.fmus.isolation.seccomp import _SECCOMP

    # The filter that stands for the kernel is installed before its own call is refused.
    got, lacking, _ = on_kernel(without(_SECCOMP), Act.TCP)
    assert got == 1
    assert "seccomp is refused (Function not implemented): sockets" in lacking[-1]
    assert on_kernel(without(_SECCOMP), Act.READS)[0] == -errno.EACCES
