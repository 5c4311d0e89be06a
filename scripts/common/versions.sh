# Sourced by scripts/oldest and scripts/newest, in the repository's root: the tests of warpchain with stated versions of its
# dependencies, in a new environment of $PYTHON.

dependencies() { # the dependencies of pyproject.toml, a line each, as they stand there
  "$PYTHON" -c '
import tomllib
print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")'
}

try_with() { # installs the requirements of standard input and warpchain beside them; tests the command line, playback, schemas, modules
  local root=$PWD
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
  unset PYTHONPATH PYTHONDONTWRITEBYTECODE # each process would compile all that it imports
  "$PYTHON" -m venv "$work/env"
  export PATH="$work/env/bin:$PATH" WARP_CACHE_PATH="$work/cache"
  cat >"$work/asked.txt"
  pip install --quiet --disable-pip-version-check --no-compile --only-binary :all: -r "$work/asked.txt"
  pip install --quiet --disable-pip-version-check --no-compile --no-deps "$root"
  pip --disable-pip-version-check check # whether the bounds of warpchain, and of the others, hold
  cd "$work" # away from the source
  warpchain check car >/dev/null
  warpchain draw car -o car.svg >/dev/null
  warpchain new new.toml --size 16B --teeth 19 57 --centers 0 0 1 0 >/dev/null
  warpchain run marine -o a.mcap --duration 0.01 --quiet >/dev/null
  warpchain report a.mcap -o a.html >/dev/null
  warpchain plot a.mcap -o figures >/dev/null
  warpchain view a.mcap --save a.rrd >/dev/null
  warpchain export a.mcap -o a.parquet >/dev/null
  warpchain fit marine --links -o fitted.toml >/dev/null
  python -c '
from warpchain import load_drive
from warpchain.errors import DriveError
from warpchain.examples import drive_path
text = drive_path("car").read_text()
others = {"viscosity = ": ", or give viscosity_40 and viscosity_100 instead"}
for key in ("viscosity = ", "ball_radius = ", "volume = "):
    open("car.toml", "w").write(text.replace(key, "no_" + key))
    try:
        load_drive("car.toml")
    except DriveError as error:
        assert any(line.endswith("missing; must be a positive number" + others.get(key, "")) for line in error.errors), error
    else:
        raise SystemExit(f"a drive without {key} is read")'
  pip freeze --disable-pip-version-check --exclude warpchain >"$work/kept.txt"
  pip install --quiet --disable-pip-version-check --no-compile -c kept.txt pytest hypothesis pillow jsonschema
  python -m pytest -q -p no:cacheprovider "$root/tests/view/test_playback.py" "$root/tests/drive/test_json_schema.py" \
    "$root/tests/kernels/test_modules.py"
  printf 'tests passed with CPython %s and\n' "$(python -c 'import platform; print(platform.python_version())')"
  python -c '
import importlib.metadata, re, sys
for line in open(sys.argv[1]):
    name = re.match(r"[\w-]+", line)[0]
    print(f"  {name} {importlib.metadata.version(name)}")' "$work/asked.txt"
}
