#!/usr/bin/env bash
# Runs the script in QGIS without a window (Debian package `qgis`), and compares its DTM with that of the command line.
#
#   host-train/packaging/qgis/test.sh ELUNAR
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
elunar="$(realpath "${1:?the program elunar expected}")"
# Debian's wrapper gives it an option that it does not know.
process="$(command -v qgis_process.bin || command -v qgis_process)" || { echo "SKIPPED: QGIS: qgis_process is not here (Debian package qgis)"; exit 0; }
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
export ELUNAR="$elunar" HOME="$work" QT_QPA_PLATFORM=offscreen XDG_RUNTIME_DIR="$work"
scripts="$work/.local/share/QGIS/QGIS3/profiles/default/processing/scripts"
mkdir -p "$scripts"
cp "$here/elunar_predict.py" "$here/dtm.qml" "$scripts"
cd "$work"
"$elunar" synth --out . --rows 96 --cols 128 --seed 5 >/dev/null
inputs=(scene_0000_image.tif scene_0000_coarse.tif)
"$elunar" predict --image "${inputs[0]}" --coarse "${inputs[1]}" --model ground --sun-azimuth=120 -o line.tif >/dev/null
"$process" run script:elunar_predict --IMAGE="${inputs[0]}" --COARSE="${inputs[1]}" --MODEL=0 --AZIMUTH=120 --OUTPUT="$work/qgis.tif" >said 2>&1 ||
    { cat said >&2; exit 1; }
"$elunar" diff qgis.tif line.tif >difference
[ "$(grep -cE "^(minimum|maximum) \[m\] +-?0\.000$" difference)" = 2 ] || { cat difference >&2; exit 1; }
! "$process" run script:elunar_predict --IMAGE="${inputs[0]}" --COARSE="${inputs[0]}" --OUTPUT="$work/wrong.tif" >said 2>&1 || { echo "ERROR: a refusal expected" >&2; exit 1; }
/usr/bin/python3 - "$scripts/dtm.qml" <<'PYTHON'
import sys
from qgis.core import QgsApplication, QgsRasterLayer
app = QgsApplication([], False)
app.initQgis()
layer = QgsRasterLayer("qgis.tif", "dtm")
message, loaded = layer.loadNamedStyle(sys.argv[1])
assert layer.isValid() and loaded and layer.renderer().type() == "hillshade", message
del layer
app.exitQgis()
PYTHON
echo "QGIS: the DTM of the command line"
