"""What a test leaves behind it: technologies that it has registered."""

from cosim.scenario import catalog


def forget() -> None:
    """Forget every technology that does not ship."""
    for name in set(catalog.TECHNOLOGIES) - {t.name for t in catalog.SHIPPED}:
        del catalog.TECHNOLOGIES[name]
    catalog.register(catalog.SHIPPED[0])
