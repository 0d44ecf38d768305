"""A simulated arm with its controller in a process of its own, asked without the code under test."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class ArmProcess:
    """`sounding controller` at a free port."""

    def __init__(self, *options):
        command = [sys.executable, "-m", "sim.cli", "controller", "--port", "0", *map(str, options)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        self.port = int(re.search(r"arm://127\.0\.0\.1:(\d+)", line)[1])
        self.address = f"arm://127.0.0.1:{self.port}"

    def record(self):
        """What the controller noted; asked again and again, since words get lost. No other client may be there."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=60.0) as connection:
            connection.settimeout(0.2)
            buffer = b""
            while True:
                connection.sendall(b'{"op":"ask-record"}\n')
                try:
                    buffer += connection.recv(1 << 16)
                except TimeoutError:
                    continue
                for line in buffer.split(b"\n")[:-1]:
                    message = json.loads(line)
                    if message["op"] == "record":
                        return message
                buffer = buffer.split(b"\n")[-1]

    def close(self):
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()
