"""Hook of mkdocs: a search finds the guide of a job first, and what is looked up after it."""

from __future__ import annotations

from typing import Any

TOPICS = {
    "guide/anatomy.md": (
        "CT scan MRI image load open read import file NIfTI NRRD DICOM SEG labels segment "
        "segmentation TotalSegmentator Slicer ITK-SNAP surface mesh STL PLY OBJ 3MF VTK organ "
        "colon stomach oesophagus phantom public data download repair holes"
    ),
    "guide/motion.md": (
        "plan planning motion path trajectory insertion scope endoscope robot move navigate joint "
        "angles colonoscopy gastroscopy colon stomach follow the leader export URDF MJCF ROS "
        "simulator result report"
    ),
    "guide/planner.md": (
        "certified certificate proof prove safe safety clearance distance wall check verify "
        "collision my own planner plugin"
    ),
    "guide/ducts.md": (
        "duct lumen tube pipe shape cylinder centreline distance field skeleton narrowest radius"
    ),
    "guide/moving.md": (
        "breathing breathe respiration heartbeat peristalsis patient moves deform slip live real "
        "time replan online"
    ),
    "guide/cockpit.md": (
        "cockpit browser page GUI interface gamepad joystick game controller keyboard drive steer "
        "interactive window"
    ),
    "guide/physics.md": (
        "contact force pressure on the wall push physics simulate simulation MuJoCo execute "
        "dynamics train reinforcement learning Gymnasium agent policy environment MCAP Foxglove "
        "ROS"
    ),
    "guide/traversability.md": (
        "does it fit through pass too wide thick largest diameter longest link size scope "
        "endoscope traversability narrow stenosis"
    ),
    "guide/trees.md": (
        "bronchi bronchoscope bronchoscopy airways tree branch lung vessel artery bifurcation SWC "
        "needle biopsy reach target"
    ),
    "guide/muscle.md": (
        "muscle McKibben pneumatic artificial soft actuator pressure contraction force contract "
        "length model"
    ),
    "guide/measurements.md": (
        "fit a muscle measured data table CSV Excel spreadsheet compare models parameters "
        "experiment columns"
    ),
    "guide/hysteresis.md": (
        "hysteresis loop backlash memory creep dead band play Bouc-Wen Prandtl friction compensate"
    ),
    "guide/effector.md": (
        "catheter tip three muscles effector workspace kinematics inverse pose stick bend angle"
    ),
    "guide/head.md": "distal head view targets instruments triangulation see",
    "guide/continuum.md": (
        "tendon robot continuum cable wire backbone pose shape kinematics forward inverse "
        "Jacobian statics friction load Cosserat rod constant curvature motion in time dynamics "
        "frequency vibration control concentric workspace"
    ),
    "guide/contact.md": (
        "contact insertion push insert buckle wall obstacle touch robot against force"
    ),
    "guide/continuum-fit.md": (
        "fit a robot measured measurements stiffness calibrate parameters identify tip error "
        "accuracy of a robot shape sensing sensor fibre FBG strain tracker estimate force"
    ),
    "guide/routing.md": "routing route helix tendons holes design best optimal path of tendons",
    "guide/fabricate.md": (
        "STEP STL CAD parts fabricate manufacture print printer printing build disc drawing"
    ),
    "guide/vision.md": (
        "camera calibration calibrate checkerboard picture photo image measure OpenCV fisheye "
        "marker track length"
    ),
    "guide/studies.md": (
        "study sweep optimise optimisation optimum parameter many runs parallel cluster batch "
        "thousands simulations compare designs Monte Carlo grid cores"
    ),
    "guide/uncertainty.md": (
        "uncertainty tolerance risk probability confidence error sensitivity Sobol how sure"
    ),
    "guide/view.md": (
        "film video movie animation animate GIF MP4 record 3-D page show view viewer visualise "
        "render display screenshot Slicer glTF Blender"
    ),
    "rig/index.md": "rig bench valve hardware real robot build set up pump compressor",
    "rig/plant.md": "plant pneumatic valve sensor tube model of the rig parameters",
    "rig/firmware.md": "firmware microcontroller flash upload AVR emulator protocol serial USB",
    "rig/boards.md": "Arduino board existing connect controller serial port own electronics",
    "rig/control.md": "control loop PID controller gain tuning tracking bandwidth",
    "rig/characterise.md": "characterise test bench record a muscle identify",
    "rig/safety.md": "hazard safety of the rig burst emergency stop",
    "tutorials/1-tract.py": "start begin first tutorial example quick",
    "tutorials/6-figure.py": "figure paper publication plot",
    "install.md": (
        "install installation set up pip conda requirements extras dependencies Windows Mac Linux "
        "Python version start begin completion doctor uninstall size"
    ),
    "index.md": "overview begin start introduction documentation",
    "cli.md": (
        "command line terminal options units mm inch psi kPa degrees exit code error message JSON "
        "output overwrite entry goal"
    ),
    "files.md": (
        "file format output result save load NPZ JSON YAML CSV Parquet Excel table schema units "
        "columns"
    ),
    "benchmarks.md": "speed fast slow performance time a job takes memory",
    "coming-from.md": "SoRoSim VMTK SOFA MATLAB SimVascular other software switch migrate",
    "trust.md": (
        "trust accurate accuracy reliable limits validated correct proved how good medical device "
        "certified clinical"
    ),
    "validation.md": "validation measured data compare experiment agreement error",
    "measured-robots.md": "measured robots data sets of tendon robots",
    "cases.md": "computed cases reference other solvers",
    "glossary.md": "glossary term word meaning definition mean what is",
    "gallery.md": "gallery pictures examples",
}
"""What a newcomer may call what a page is about; a search counts it more than titles."""

BOOSTS = {"guide": 4.0, "rig": 3.0, "tutorials": 2.0, "theory": 1.0, "api": 0.2, "reference": 0.2}
"""How much a folder's pages count in a search."""

OTHERS = 0.5
CHOSEN = 3.0
"""How much other pages count, and those of them that have topics."""


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page as it is, and note how the search counts it; mkdocs calls this for each."""
    place = page.file.src_uri
    boost = BOOSTS.get(place.partition("/")[0], CHOSEN if place in TOPICS else OTHERS)
    page.meta.setdefault("search", {})["boost"] = boost
    if place in TOPICS:
        page.meta["tags"] = [TOPICS[place]]
    return markdown
