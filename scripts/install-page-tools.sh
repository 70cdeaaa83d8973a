#!/usr/bin/env bash
# The report's script is checked by the compiler of TypeScript, the page itself by axe-core.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
name=page-tools from=tests/output/page/tools needs=typescript/package.json
. scripts/npm.sh
