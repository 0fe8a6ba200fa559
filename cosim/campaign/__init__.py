"""Many flights: draws, one pool of workers, a folder of rows; `cosim.campaign.flights` flies them.

Nothing is imported here: a worker imports this package, and needs neither pandas nor what writes tables.
"""
