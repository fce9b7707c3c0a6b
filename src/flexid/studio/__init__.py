"""Studio: a local web page for identification of logs."""

from importlib.util import find_spec

from flexid.errors import SettingError


def need_packages() -> None:
    """Raise `SettingError` unless the packages of the extra are installed."""
    for package in ("starlette", "uvicorn", "websockets"):
        if find_spec(package) is None:
            raise SettingError(
                "studio",
                f"it needs {package}, which is not installed: pip install 'flexid[studio]'",
            )
