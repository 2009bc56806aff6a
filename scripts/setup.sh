# Sourced by the other scripts: makes .venv with the extras named in $1 and puts it on PATH.
# Does nothing when these, or more, were installed already by this pyproject.toml and
# constraints.txt: the stamp in .venv holds their checksum, and then a line for each extra.

repo=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

find_python() { # $1: a command that must hold of it
  local candidate
  for candidate in "${PYTHON:-}" python3.14 python3.13 python3.12 python3.11 python3 ${1:+/usr/bin/python3}; do
    [ -n "$candidate" ] && command -v "$candidate" >/dev/null && "${1:-true}" "$candidate" || continue
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
  echo "teleop-rt needs Python 3.11 or newer; install it (Debian 12, Ubuntu 24.04 and later: apt install python3 python3-venv) and run this again." >&2
  return 1
}

installed() { # $1: the stamp, $2: the checksum, $3: the extras
  local told extra
  told=$(cat "$1" 2>/dev/null)
  [ "${told%%$'\n'*}" = "$2" ] || return 1
  for extra in ${3//,/ }; do
    case "$told"$'\n' in *$'\n'"$extra"$'\n'*) ;; *) return 1 ;; esac
  done
}

setup_venv() {
  local extras=$1 python stamp pinned
  python=$(find_python) || exit 2
  stamp="$repo/.venv/teleop-rt.stamp"
  pinned=$(cat "$repo/pyproject.toml" "$repo/constraints.txt" | cksum)
  if ! installed "$stamp" "$pinned" "$extras"; then
    if ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
      echo "Python's venv module is missing; install it (Debian, Ubuntu: apt install python3-venv) and run this again." >&2
      exit 2
    fi
    echo "Setting up $repo/.venv (a minute or two, once) ..." >&2
    [ -x "$repo/.venv/bin/python" ] || "$python" -m venv "$repo/.venv" || exit 2
    "$repo/.venv/bin/python" -m pip install --quiet --disable-pip-version-check \
      --constraint "$repo/constraints.txt" --editable "$repo[$extras]" || {
      echo "Installing failed; the lines above say why. Is a package index reachable?" >&2
      exit 2
    }
    # Where Python may not write what it has compiled, every process would compile it all again.
    "$repo/.venv/bin/python" -m compileall -q "$repo/teleop_rt" "$repo/drivers" || true
    installed "$stamp" "$pinned" "" || echo "$pinned" >"$stamp"
    echo "${extras//,/$'\n'}" >>"$stamp"
  fi
  PATH="$repo/.venv/bin:$PATH"
}
