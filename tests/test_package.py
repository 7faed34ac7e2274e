"""What `import jaxslam` gives, and what it does not load."""

import subprocess
import sys

import jaxslam


def test_importing_loads_the_core_only():
    heavy = ("matplotlib", "rosbags", "tyro", "PIL", "tqdm", "scipy")
    code = f"import sys, jaxslam; print([name for name in {heavy} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_every_public_name_is_there():
    packages = [getattr(jaxslam, name) for name in jaxslam.__all__]
    packages = [jaxslam, *(p for p in packages if getattr(p, "__all__", None))]
    assert len(packages) > 5
    for package in packages:
        assert list(package.__all__) == sorted(set(package.__all__), key=package.__all__.index)
        for name in package.__all__:
            assert hasattr(package, name)
