#!/usr/bin/python3
"""`esmc drive` over a real vcan0. usage: drive_test.py ESMC SCENE"""
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

job = subprocess.run([HERE / "with_vcan", "--timeout", "300", "--", "/usr/bin/python3", HERE / "drive_client.py",
                      *(Path(a).resolve() for a in sys.argv[1:3])], capture_output=True, text=True)
print(job.stdout, job.stderr)
sys.exit(job.returncode)
