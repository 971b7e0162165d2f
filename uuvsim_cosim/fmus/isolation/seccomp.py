"""Seccomp: a filter of this process's system calls, whose refusals another process can name.

The filter is a program of the kernel's classic BPF. It is for x86_64 and aarch64.
"""

from __future__ import annotations

import ctypes
import errno
import os
import struct
from collections.abc import Sequence

from uuvsim_cosim.fmus.isolation.system_calls import AUDIT, GROUPS, NUMBERS

__all__ = ["LARGE", "filter_of", "install"]

LARGE = 64 << 20  # [bytes] of one piece of memory, from which on it is examined
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _AND, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x54, 0x06
_ALLOW, _ERROR, _NOTIFY = 0x7FFF0000, 0x00050000, 0x7FC00000
_NUMBER, _MACHINE, _ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data
_X32 = 0x40000000  # numbers of x86_64's calls with short pointers
_THREAD = 0x10000  # CLONE_THREAD
_STREAM, _INTERNET, _INTERNET_6, _PROTOCOL_TCP = 1, 2, 10, 6
_SECCOMP = 317 if AUDIT == 0xC000003E else 277
_SET_FILTER, _ALL_THREADS, _LISTENER, _ALL_OR_ERROR = 1, 1, 1 << 3, 1 << 4
_NO_NEW_PRIVILEGES = 38

Instruction = tuple[int, int, int, int]  # code, jump if true, jump if false, constant


def filter_of(
    process: int, *, notify: bool, network: bool, ports: bool, processes: bool
) -> list[Instruction]:
    """Return the program for the process number; what is not refused is allowed.

    `network`, `ports` (TCP only) and `processes` are granted. Without `notify`, refused calls
    return EACCES, and calls that are examined only for their names are left alone.
    """
    refused = _NOTIFY if notify else _ERROR | errno.EACCES
    program = [
        _load(_MACHINE), (_EQUAL, 1, 0, AUDIT), _return(_ERROR | errno.ENOSYS),
        _load(_NUMBER), (_AT_LEAST, 0, 1, _X32), _return(_ERROR | errno.ENOSYS),
    ]  # fmt: skip
    names = [n for g in ("others", "attributes", "hidden memory", "system") for n in GROUPS[g]]
    names += [] if processes else GROUPS["processes"]
    names += [*GROUPS["open"], *GROUPS["change"]] if notify else []
    for name in names:
        program += _case(name, [_return(refused)])
    for name in GROUPS["own"]:  # signals to this process
        program += _case(
            name, [_low(0), (_EQUAL, 0, 1, process), _return(_ALLOW), _return(refused)]
        )
    if not network:
        tcp = [
            _low(0), (_EQUAL, 1, 0, _INTERNET), (_EQUAL, 0, 7, _INTERNET_6),
            _low(1), (_AND, 0, 0, 0xF), (_EQUAL, 0, 4, _STREAM),
            _low(2), (_EQUAL, 1, 0, 0), (_EQUAL, 0, 1, _PROTOCOL_TCP),
            _return(_ALLOW),
        ]  # fmt: skip
        program += _case("socket", [*(tcp if ports else []), _return(refused)])
    if not processes:  # clone3 has its flags in memory: libraries use clone instead
        program += _case("clone3", [_return(_ERROR | errno.ENOSYS)])
        threads = [_low(0), (_ANY_BIT, 0, 1, _THREAD), _return(_ALLOW), _return(refused)]
        program += _case("clone", threads)
    if notify:
        for name, argument in (("mmap", 1), ("mremap", 2)):
            sizes = [
                _high(argument), (_AT_LEAST, 2, 0, 1), _low(argument), (_AT_LEAST, 0, 1, LARGE),
                _return(_NOTIFY), _return(_ALLOW),
            ]  # fmt: skip
            program += _case(name, sizes)
    program += _case("setrlimit", [_return(refused)])
    read_only = [
        _low(2), (_EQUAL, 0, 2, 0), _high(2), (_EQUAL, 1, 0, 0), _return(refused), _return(_ALLOW),
    ]  # fmt: skip
    return [*program, *_case("prlimit64", read_only), _return(_ALLOW)]


def install(program: Sequence[Instruction], *, notify: bool) -> int:
    """Apply a filter to all threads; return the descriptor of its listener, or -1 without one.

    Raises OSError.
    """
    c = ctypes.CDLL(None, use_errno=True)
    c.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *i) for i in program))
    whole = struct.pack("@HP", len(program), ctypes.addressof(code))
    flags = _ALL_THREADS | (_LISTENER | _ALL_OR_ERROR if notify else 0)
    done: int = c.syscall(_SECCOMP, _SET_FILTER, flags, whole)
    if done < 0 or (done > 0 and not notify):
        number = ctypes.get_errno() if done < 0 else errno.ESRCH
        raise OSError(number, os.strerror(number))
    return done if notify else -1


def _case(name: str, body: list[Instruction]) -> list[Instruction]:
    """Return the instructions for one call; the body ends in returns. The number is loaded."""
    if NUMBERS[name] < 0:
        return []
    return [(_EQUAL, 0, len(body), NUMBERS[name]), *body]


def _load(offset: int) -> Instruction:
    return _LOAD, 0, 0, offset


def _low(argument: int) -> Instruction:
    return _load(_ARGUMENTS + 8 * argument)  # both machines are little-endian


def _high(argument: int) -> Instruction:
    return _load(_ARGUMENTS + 8 * argument + 4)


def _return(action: int) -> Instruction:
    return _RETURN, 0, 0, action
