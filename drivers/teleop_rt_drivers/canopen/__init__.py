"""An axis of CANopen devices: encoder (CiA 406), force sensor (CiA 404) and drive (CiA 402)."""
