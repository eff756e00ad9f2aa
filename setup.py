"""The folders of the repository as one package: `kernels/` is installed as `usvauv.kernels`, and so on."""

from setuptools import find_packages, setup

FOLDERS = {
    "usvauv": "src/usvauv",
    "usvauv.kernels": "kernels",
    "usvauv.env": "usvauv_env",
    "usvauv.policies": "policies",
    "usvauv.cli": "usvauv_cli",
}

setup(
    package_dir=FOLDERS,
    packages=[
        package if inner == "." else f"{package}.{inner}"
        for package, folder in FOLDERS.items()
        for inner in (".", *find_packages(folder))
    ],
)
