"""A Processing algorithm for QGIS: `elunar predict` on layers of the project.

Into the folder of scripts of the profile (Processing, Scripts, Add Script to Toolbox). The program `elunar` is found on PATH, or named by ELUNAR.
"""

import json
import os
import pathlib
import shutil
import subprocess

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingParameterEnum,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterRasterLayer,
)

MODELS = ["ground", "nano"]


class Style(QgsProcessingLayerPostProcessorInterface):
    """Shows the DTM as a hillshade, as dtm.qml beside this script."""

    kept = None

    def postProcessLayer(self, layer, context, feedback):
        layer.loadNamedStyle(str(pathlib.Path(__file__).with_name("dtm.qml")))
        layer.triggerRepaint()


class ElunarPredict(QgsProcessingAlgorithm):
    def createInstance(self):
        return ElunarPredict()

    def name(self):
        return "elunar_predict"

    def displayName(self):
        return "DTM from one image"

    def group(self):
        return "ELunarDTM"

    def groupId(self):
        return "elunardtm"

    def shortHelpString(self):
        return "Makes a DTM at an image's resolution from the image and a coarse DTM. Angles of the Sun that are not given are the file's, or fitted."

    def initAlgorithm(self, config=None):
        angle = QgsProcessingParameterNumber.Double
        self.addParameter(QgsProcessingParameterRasterLayer("IMAGE", "Image"))
        self.addParameter(QgsProcessingParameterRasterLayer("COARSE", "Coarse DTM, heights in metres"))
        self.addParameter(QgsProcessingParameterEnum("MODEL", "Model", MODELS, defaultValue=0))
        self.addParameter(QgsProcessingParameterNumber("AZIMUTH", "Sun's azimuth, clockwise from the grid's up", angle, None, True, -360, 360))
        self.addParameter(QgsProcessingParameterNumber("ELEVATION", "Sun's elevation", angle, None, True, 0, 90))
        self.addParameter(QgsProcessingParameterRasterDestination("OUTPUT", "DTM"))

    def processAlgorithm(self, parameters, context, feedback):
        program = os.environ.get("ELUNAR") or shutil.which("elunar")
        if program is None:
            raise QgsProcessingException("elunar: expected on PATH, or named by ELUNAR; not found")
        layer = lambda name: self.parameterAsRasterLayer(parameters, name, context).source()
        output = self.parameterAsOutputLayer(parameters, "OUTPUT", context)
        command = [program, "predict", "--image", layer("IMAGE"), "--coarse", layer("COARSE"), "-o", output, "--json"]
        command += ["--model", MODELS[self.parameterAsEnum(parameters, "MODEL", context)], "--progress", "json"]
        for name, option in [("AZIMUTH", "--sun-azimuth"), ("ELEVATION", "--sun-elevation")]:
            if parameters.get(name) is not None:
                command.append(f"{option}={self.parameterAsDouble(parameters, name, context)}")
        made = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        said = []
        for line in made.stderr:
            if feedback.isCanceled():
                made.terminate()
            try:
                words = json.loads(line)
            except ValueError:
                said.append(line.strip())
                continue
            progress = words.get("progress", {})
            if progress.get("all"):
                feedback.setProgress(100 * progress["done"] / progress["all"])
            if "warning" in words:
                feedback.pushWarning(words["warning"])
            elif not progress:
                said.append(words.get("error", line.strip()))
        found = made.stdout.read()
        if made.wait() != 0:
            raise QgsProcessingException(said[-1] if said else f"elunar ended with {made.returncode}")
        feedback.pushInfo(found)
        if context.willLoadLayerOnCompletion(output):
            Style.kept = Style()  # QGIS does not keep it
            context.layerToLoadOnCompletionDetails(output).setPostProcessor(Style.kept)
        return {"OUTPUT": output}
