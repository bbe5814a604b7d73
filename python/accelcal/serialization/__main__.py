"""Write the JSON schemas: `python -m accelcal.serialization schemas`."""

import sys
from pathlib import Path

from accelcal.serialization.schema.publish import publish

if __name__ == "__main__":
    for written in publish(Path(sys.argv[1] if len(sys.argv) > 1 else "schemas")):
        print(written)
