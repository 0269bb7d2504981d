"""Says which commands this package has: ``python -m sbm_gym``."""

import sys

from labeling.runtime.package_commands import make_main

main = make_main("sbm_gym")

if __name__ == "__main__":
    sys.exit(main())
