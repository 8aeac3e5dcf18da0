"""Where a process listens, as the kernel says."""

import re
import socket
import sys
from contextlib import suppress
from pathlib import Path


def listening(pid: int) -> set[str]:
    """Return the TCP addresses on which a process listens."""
    links = []
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed since it was listed
            links.append(str(file.readlink()))
    inodes = {match[1] for link in links if (match := re.fullmatch(r"socket:\[(\d+)\]", link))}
    found = set()
    for name, family in (("tcp", socket.AF_INET), ("tcp6", socket.AF_INET6)):
        for line in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in inodes:  # 0A: it listens
                address, _, port = fields[1].partition(":")
                words = [int(address[i : i + 8], 16) for i in range(0, len(address), 8)]
                packed = b"".join(word.to_bytes(4, sys.byteorder) for word in words)
                found.add(f"{socket.inet_ntop(family, packed)}:{int(port, 16)}")
    return found
