#!/usr/bin/env bash
# A program that uses the library is checked by pyright too, the type checker of many editors.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
name=pyright from=tests/typed needs=pyright/package.json
. scripts/npm.sh
