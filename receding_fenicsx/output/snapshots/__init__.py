"""PyVista pictures, films and ParaView fields of the whole body."""
