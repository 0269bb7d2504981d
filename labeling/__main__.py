"""Says which commands this package has: ``python -m labeling``."""

import sys

from labeling.runtime.package_commands import make_main

main = make_main("labeling")

if __name__ == "__main__":
    sys.exit(main())
