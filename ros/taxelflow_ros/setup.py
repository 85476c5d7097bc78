"""Installs the node and its launch file, as ament_python wants it."""

from setuptools import setup

NAME = "taxelflow_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/slip.launch.py"]),
    ],
    install_requires=["setuptools", "taxelflow"],
    zip_safe=True,
    maintainer="The taxelflow authors",
    maintainer_email="taxelflow@example.org",
    description="Motion and slip of a grasped object from a topic of tactile scans, by taxelflow.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"slip = {NAME}.node:main"]},
)
