"""An access file says who may do what; its mistakes are all told, and passwords never."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.bridge.guarded import PASSWORDS, access_file
from uuvsim_cosim.bridge.access.access_file import LOOPBACK, is_loopback, read_access
from uuvsim_cosim.bridge.access.authentication import Authenticator
from uuvsim_cosim.bridge.access.passwords import hashed, is_hash, matches
from uuvsim_cosim.bridge.access.roles import ROLES
from uuvsim_cosim.bridge.access.transports import server_settings
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid

# ---- passwords --------------------------------------------------------------------------------


def test_a_hash_matches_its_password_only_and_is_salted() -> None:
    first = hashed("Nautilus")
    assert matches("Nautilus", first)
    assert not matches("nautilus", first)
    assert first != hashed("Nautilus")
    assert "Nautilus" not in first


@given(st.text(max_size=80))
@settings(max_examples=50)
def test_no_text_but_a_hash_is_taken_for_one(text: str) -> None:
    assert not is_hash(text)
    assert not matches("x", text)


@pytest.mark.parametrize(
    "text",
    [
        "scrypt$1073741824$8$1$AAAAAAAAAAAAAAAAAAAAAA==$" + "A" * 43 + "=",
        "scrypt$16384$8$1$AAAA$" + "A" * 43 + "=",
        "scrypt$16383$8$1$AAAAAAAAAAAAAAAAAAAAAA==$" + "A" * 43 + "=",
        "scrypt$16384$8$1$AAAAAAAAAAAAAAAAAAAAAA==$AAAA",
    ],
)
def test_a_hash_that_costs_too_much_or_too_little_is_refused(text: str) -> None:
    assert not is_hash(text)


# ---- the file ---------------------------------------------------------------------------------


def test_a_file_says_who_may_do_what(tmp_path: Path) -> None:
    access = read_access(access_file(tmp_path, "anyone: observer", "listen: [127.0.0.1]"))
    assert {name: user.role for name, user in access.users.items()}["cy"] == "controller"
    assert access.anonymous == {"read"}
    assert access.listen == ("127.0.0.1",)


def test_without_a_word_about_others_they_may_do_nothing(tmp_path: Path) -> None:
    access = read_access(access_file(tmp_path))
    assert access.anonymous == frozenset()
    assert access.listen == LOOPBACK


def test_every_mistake_is_told_with_its_line(tmp_path: Path) -> None:
    file = access_file(
        tmp_path,
        "  eve: {role: ownr, password: hunter2}",
        "  f/g: {role: owner}",
        "anyon: observer",
        "listen: [localhosts]",
        "tls: {certificate: none.pem}",
        users=("ann",),
    )
    with pytest.raises(InputInvalid) as refused:
        read_access(file)
    said = str(refused.value)
    assert "access.yaml:3: users.eve.role: role 'ownr'; expected one such as owner" in said
    assert "access.yaml:3: users.eve.password: not a salted hash" in said
    assert "hunter2" not in said
    assert "access.yaml:4: users.f/g: a name has letters" in said
    assert "access.yaml:5: anyon: unknown; expected one such as anyone" in said
    assert "access.yaml:6: listen.1: localhosts is no address" in said
    assert "access.yaml:7: tls: has no key" in said
    assert "access.yaml:7: tls.certificate: none.pem: no such file" in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "nothing; expected a mapping with users"),
        ("[]", "a list; expected a mapping"),
        ("listen: 127.0.0.1", "no client is admitted"),
        ("users: 3", "expected a mapping, such as ann"),
        ("users: {5: 7}", "users.5: 7; expected a mapping"),
        ("users: {ann: {role: owner, role: owner}}", "expected each name once"),
        ("anyone: observer\nlisten: 0.0.0.0", "0.0.0.0 without tls"),
        ("anyone: observer\ntls: {roles: {a: owner}}", "has no certificate"),
        ("anyone: [1]", "role a list"),
        ("\x00", "cannot be read as YAML"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "access.yaml"
    file.write_text(text)
    with pytest.raises(InputInvalid, match=r"access\.yaml") as refused:
        read_access(file)
    assert words in str(refused.value)


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="expected an access file"):
        read_access(tmp_path / "none.yaml")


# ---- access ----------------------------------------------------------------------------------


def test_a_user_has_the_permissions_of_its_role(tmp_path: Path) -> None:
    authenticator = Authenticator(read_access(access_file(tmp_path)))
    assert authenticator("bob", PASSWORDS["bob"]) == ROLES["observer"]
    assert authenticator("ann", PASSWORDS["ann"]) == ROLES["owner"]


@pytest.mark.parametrize(
    ("user", "password", "words"),
    [
        (None, None, "requires a login; expected user and password"),
        ("ann", "periscope", "user 'ann' or the password is wrong"),
        ("ann", None, "user 'ann' or the password is wrong"),
        ("nobody", "periscope", "user 'nobody' or the password is wrong"),
        ("ann", "\ud800", "user 'ann' or the password is wrong"),
    ],
)
def test_who_may_not_enter_is_told_why(
    tmp_path: Path, user: str | None, password: str | None, words: str
) -> None:
    authenticator = Authenticator(read_access(access_file(tmp_path)))
    with pytest.raises(InputInvalid, match=words):
        authenticator(user, password)


def test_nobody_is_locked_out_by_wrong_passwords_of_others(tmp_path: Path) -> None:
    authenticator = Authenticator(read_access(access_file(tmp_path)))
    for k in range(9):
        with pytest.raises(InputInvalid, match="is wrong"):
            authenticator("ann", f"guess {k}")
    assert authenticator("ann", PASSWORDS["ann"]) == ROLES["owner"]


def test_a_wrong_password_says_nothing_of_whether_the_user_exists(tmp_path: Path) -> None:
    authenticator = Authenticator(read_access(access_file(tmp_path)))
    said: dict[str, list[str]] = {"ann": [], "eve": [], "eva": []}
    for _ in range(9):
        for name, words in said.items():
            with pytest.raises(InputInvalid) as refused:
                authenticator(name, "guess")
            words.append(str(refused.value).replace(name, "NAME"))
    assert said["ann"] == said["eve"] == said["eva"]


def test_an_unknown_user_is_checked_as_long_as_a_known_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    authenticator = Authenticator(read_access(access_file(tmp_path)))
    costs: list[list[str]] = []

    def spied(password: str, text: str) -> bool:
        costs.append(text.split("$")[1:4])
        return False

    monkeypatch.setattr("uuvsim_cosim.bridge.access.authentication.matches", spied)
    for name in ("ann", "eve"):
        with pytest.raises(InputInvalid):
            authenticator(name, "guess")
    assert costs[0] == costs[1]


def test_who_is_in_waits_for_no_password_of_others(tmp_path: Path) -> None:
    authenticator = Authenticator(read_access(access_file(tmp_path)))
    assert authenticator("ann", PASSWORDS["ann"])
    with authenticator._lock:  # as while another password is checked
        assert authenticator("ann", PASSWORDS["ann"])


# ---- where endpoints open ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("localhost", True),
     ("0.0.0.0", False), ("::", False), ("192.168.1.4", False), ("rov.local", False)],
)  # fmt: skip
def test_loopback_is_what_only_this_machine_reaches(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


def test_endpoints_do_not_open_unguarded_beyond_this_machine(tmp_path: Path) -> None:
    file = access_file(tmp_path)
    with pytest.raises(InputInvalid, match="expected --access FILE with users and roles"):
        server_settings(None, ["0.0.0.0"])
    with pytest.raises(InputInvalid, match="has no tls"):
        server_settings(file, ["0.0.0.0"])
    with pytest.raises(InputInvalid, match="expected one"):
        server_settings(file, anyone=True)
    assert server_settings(None, ["0.0.0.0"], anyone=True).authenticator is None
    assert (
        server_settings(access_file(tmp_path, "tls: none"), ["0.0.0.0"]).authenticator is not None
    )


def test_the_command_refuses_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["serve", "bluerov2_hold", "--host", "0.0.0.0"]) == 2
    assert "--anyone to admit everybody" in capsys.readouterr().err
    assert status_of(["access", "check", str(access_file(tmp_path, "anyone: observer"))]) == 0
    said = capsys.readouterr().out
    assert "manage, read, set, step" in said
    assert "no TLS; listens at 127.0.0.1, ::1" in said
