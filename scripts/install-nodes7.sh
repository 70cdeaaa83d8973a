#!/usr/bin/env bash
# The fake PLC is tested with nodes7, a client of the world of Node.js.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
name=nodes7 from=captures/record needs=nodes7
. scripts/npm.sh
