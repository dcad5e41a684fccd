"""What the end of a process means, in words."""

from __future__ import annotations

import signal

SIGNALS = {
    "SIGSEGV": "a bad memory access, a stack overflow, or memory that it was refused and used",
    "SIGBUS": "a bad memory access",
    "SIGABRT": "it called abort(), as a failed assertion, an uncaught C++ exception or a broken heap do",
    "SIGFPE": "a floating-point trap, or an integer division by zero",
    "SIGILL": "an instruction that this processor does not know",
    "SIGSYS": "a system call that is not allowed",
    "SIGTRAP": "a trap, as compilers put where code must not be reached",
    "SIGKILL": "it was killed from outside, mostly by the system when memory runs out",
    "SIGXCPU": "it used up its processor time",
    "SIGXFSZ": "it wrote a file beyond the limit",
}

WINDOWS = {
    0xC0000005: ("STATUS_ACCESS_VIOLATION", SIGNALS["SIGSEGV"]),
    0xC00000FD: ("STATUS_STACK_OVERFLOW", "a stack overflow"),
    0xC0000017: ("STATUS_NO_MEMORY", "no memory was left"),
    0xC000001D: ("STATUS_ILLEGAL_INSTRUCTION", SIGNALS["SIGILL"]),
    0xC000008E: ("STATUS_FLOAT_DIVIDE_BY_ZERO", "a floating-point trap"),
    0xC0000094: ("STATUS_INTEGER_DIVIDE_BY_ZERO", "an integer division by zero"),
    0xC0000374: ("STATUS_HEAP_CORRUPTION", "a broken heap"),
    0xC0000409: ("STATUS_STACK_BUFFER_OVERRUN", SIGNALS["SIGABRT"]),
}


def cause_of_death(code: int) -> str:
    """Say how a process ended.

    Parameters
    ----------
    code : int
        As `subprocess.Popen.returncode` has it: the exit code, or the signal with a minus.
    """
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            return f"signal {-code}"
        return f"{name}, {SIGNALS[name]}" if name in SIGNALS else name
    if code in WINDOWS:
        return ", ".join(WINDOWS[code])
    return f"it left by exit({code})"


def last_lines(log: bytes, count: int = 5, longest: int = 200) -> str:
    """Quote the end of a log; empty where it says nothing.

    Parameters
    ----------
    log : bytes
        The log's end.
    count : int
        Lines at most.
    longest : int
        Characters of a line at most.
    """
    text = log.decode("utf-8", "replace")
    printable = "".join(c if c.isprintable() or c == "\n" else " " for c in text)
    lines = [line.strip() for line in printable.splitlines() if line.strip()][-count:]
    return "; ".join(line if len(line) <= longest else line[:longest] + "..." for line in lines)
