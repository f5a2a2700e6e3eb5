"""Hook of mkdocs: a search finds the guide of a job first, and what is looked up after it."""

from __future__ import annotations

from typing import Any

TOPICS = {
    "guide/anatomy.md": "CT scan, labels, surface, read, segment, TotalSegmentator, Slicer",
    "guide/motion.md": "plan, scope, motion, export, URDF, ROS",
    "guide/planner.md": "certified, proof, clearance",
    "guide/ducts.md": "duct, lumen, shapes, centreline",
    "guide/moving.md": "breathing, peristalsis, slip, live",
    "guide/cockpit.md": "cockpit, browser, gamepad, joystick",
    "guide/physics.md": "contact force, MuJoCo, execute, reinforcement learning, Gymnasium",
    "guide/traversability.md": "does it fit, diameter, longest link, traversability",
    "guide/trees.md": "bronchi, tree, branch, lung, vessel",
    "guide/muscle.md": "muscle, McKibben, pressure, contraction",
    "guide/measurements.md": "fit a muscle, measured muscle, compare models",
    "guide/hysteresis.md": "hysteresis, loop, backlash, memory",
    "guide/effector.md": "catheter tip, three muscles, effector, workspace",
    "guide/head.md": "distal head, camera view, targets",
    "guide/continuum.md": "tendon robot, continuum, pose, friction, motion in time, frequency",
    "guide/contact.md": "contact, insertion, push, wall",
    "guide/continuum-fit.md": "fit a robot, tip error, shape sensors, estimate",
    "guide/routing.md": "routing, helix, design of tendons",
    "guide/fabricate.md": "STEP, parts, fabricate, print",
    "guide/vision.md": "camera, calibrate, checkerboard, picture",
    "guide/studies.md": "study, sweep, optimise",
    "guide/uncertainty.md": "uncertainty, tolerance, risk",
    "guide/view.md": "film, 3-D page, show",
    "rig/index.md": "rig, bench, valve",
    "rig/firmware.md": "firmware, microcontroller",
    "install.md": "install, extras, Windows",
    "benchmarks.md": "speed, time a job takes",
    "coming-from.md": "SoRoSim, VMTK, SOFA, MATLAB",
}
"""What a page is the place to begin with; a search counts it as it counts titles."""

BOOSTS = {"guide": 4.0, "rig": 4.0, "tutorials": 2.0, "theory": 1.0, "api": 0.2, "reference": 0.2}
"""How much a folder's pages count in a search."""

OTHERS = 0.5


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page as it is, and note how the search counts it; mkdocs calls this for each."""
    place = page.file.src_uri
    page.meta.setdefault("search", {})["boost"] = BOOSTS.get(place.partition("/")[0], OTHERS)
    if place in TOPICS:
        page.meta["tags"] = TOPICS[place].split(", ")
    return markdown
