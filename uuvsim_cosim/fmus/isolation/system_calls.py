"""System calls that the sandbox examines: names, numbers and groups.

Numbers from the kernel's ``syscall_64.tbl`` (x86_64) and ``asm-generic/unistd.h`` (aarch64).
"""

from __future__ import annotations

import platform

__all__ = ["AUDIT", "GROUPS", "NAMES", "NUMBERS"]

_X86 = platform.machine().lower() in ("x86_64", "amd64")
AUDIT = 0xC000003E if _X86 else 0xC00000B7  # the kernel's name of this machine's calls

# Group: each name with its number on x86_64 and on aarch64; -1: that machine has no such call.
_TABLE = {
    "network": "socket 41 198",
    "processes": "fork 57 -1, vfork 58 -1, execve 59 221, execveat 322 281",
    # Memory and descriptors of other processes, and signals whose process is no argument.
    "others": (
        "ptrace 101 117, process_vm_readv 310 270, process_vm_writev 311 271, kcmp 312 272, "
        "pidfd_open 434 434, pidfd_getfd 438 438, pidfd_send_signal 424 424, "
        "process_madvise 440 440, tkill 200 130, rt_sigqueueinfo 129 138, "
        "rt_tgsigqueueinfo 297 240, shmget 29 194, msgget 68 186, semget 64 190, mq_open 240 180"
    ),
    "own": "kill 62 129, tgkill 234 131",
    "open": "open 2 -1, openat 257 56, openat2 437 437, creat 85 -1",
    # Changes of folders. Landlock decides; the name is found here.
    "change": (
        "unlink 87 -1, unlinkat 263 35, rename 82 -1, renameat 264 38, renameat2 316 276, "
        "mkdir 83 -1, mkdirat 258 34, rmdir 84 -1, link 86 -1, linkat 265 37, symlink 88 -1, "
        "symlinkat 266 36, mknod 133 -1, mknodat 259 33, truncate 76 45"
    ),
    # Landlock does not know attributes of files: they are refused here.
    "attributes": (
        "chmod 90 -1, fchmod 91 52, fchmodat 268 53, fchmodat2 452 452, chown 92 -1, fchown 93 55, "
        "lchown 94 -1, fchownat 260 54, setxattr 188 5, lsetxattr 189 6, fsetxattr 190 7, "
        "removexattr 197 14, lremovexattr 198 15, fremovexattr 199 16, setxattrat 463 463, "
        "removexattrat 466 466, utime 132 -1, utimes 235 -1, futimesat 261 -1, utimensat 280 88"
    ),
    "memory": "mmap 9 222, mremap 25 216",
    "hidden memory": "memfd_create 319 279, memfd_secret 447 447",
    "limits": "prlimit64 302 261, setrlimit 160 164",
    # Another way to open files and sockets, and calls of administrators, who may run simulations.
    "system": (
        "io_uring_setup 425 425, mount 165 40, umount2 166 39, pivot_root 155 41, chroot 161 51, "
        "setns 308 268, unshare 272 97, bpf 321 280, perf_event_open 298 241, init_module 175 105, "
        "finit_module 313 273, delete_module 176 106, kexec_load 246 104, kexec_file_load 320 294, "
        "reboot 169 142, swapon 167 224, swapoff 168 225, settimeofday 164 170, "
        "clock_settime 227 112, clock_adjtime 305 266, adjtimex 159 171, sethostname 170 161, "
        "setdomainname 171 162, keyctl 250 219, add_key 248 217, request_key 249 218, "
        "iopl 172 -1, ioperm 173 -1, acct 163 89, quotactl 179 60, quotactl_fd 443 443, "
        "userfaultfd 323 282, open_by_handle_at 304 265, move_mount 429 429, open_tree 428 428, "
        "fsopen 430 430, fsconfig 431 431, fsmount 432 432, fspick 433 433, "
        "mount_setattr 442 442, syslog 103 116, vhangup 153 58"
    ),
    "clone": "clone 56 220, clone3 435 435",
}

NUMBERS: dict[str, int] = {}
GROUPS: dict[str, tuple[str, ...]] = {}
for _group, _calls in _TABLE.items():
    _found = [call.split() for call in _calls.split(", ")]
    NUMBERS |= {name: int(x86 if _X86 else arm) for name, x86, arm in _found}
    GROUPS[_group] = tuple(name for name, *_ in _found if NUMBERS[name] >= 0)
NAMES = {number: name for name, number in NUMBERS.items() if number >= 0}
