#!/bin/sh
# The wheel, built from the checkout and used without it: a fresh environment, another folder, the demo's commands.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/env"
pip() { "$folder/env/bin/python" -m pip --quiet --disable-pip-version-check "$@"; }
pip wheel --no-deps --wheel-dir "$folder/wheels" "$root"
wheel=$(ls "$folder"/wheels/*.whl)
pip install --constraint "$root/constraints.txt" "${wheel}[plot,report]"
cd "$folder"
PATH="$folder/env/bin:$PATH"
taxelflow simulate stroke --out stroke.npz
taxelflow estimate stroke.npz --out convolution
taxelflow plot convolution --out pictures --format png
taxelflow film convolution slip.gif
taxelflow report convolution --out report.html
python -c "import taxelflow; assert '$root' not in taxelflow.__file__, taxelflow.__file__"
test -s pictures/position-palm.png && test -s slip.gif && test -s report.html
echo "the wheel works outside the checkout"
