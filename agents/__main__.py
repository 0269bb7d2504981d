"""Says which commands this package has: ``python -m agents``."""

import sys

from labeling.runtime.package_commands import make_main

main = make_main("agents")

if __name__ == "__main__":
    sys.exit(main())
