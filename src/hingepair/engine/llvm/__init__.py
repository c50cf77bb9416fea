"""Machine code of traces: written as LLVM IR, compiled, loaded, kept on disk.

builder                 text of LLVM functions: loops, branches, shuffles
arithmetic, sines       the operations of a trace as straight-line steps; sines and cosines
memory                  loads of samples into vectors, stores of results
ir, scan                the loop over samples around the steps; the same with a loop over time
native, images          from the IR to functions in this process; code that runs without llvmlite
object_cache            code on disk
"""
