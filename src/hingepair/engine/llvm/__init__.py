"""Machine code of traces: written as LLVM IR, compiled, loaded, kept on disk.

builder                 text of LLVM functions: loops, branches, shuffles
schedule                which step computes a value of a trace, and where the frame keeps it
arithmetic, sines       the steps as straight-line code; sines and cosines
memory                  loads of samples into vectors, stores of results
ir, scan                the loop over samples around the steps; the same with a loop over time
native, images          from the IR to functions in this process; code that runs without llvmlite
object_cache            code on disk
direct                  the call of a kernel by Python itself, for arrays that need no conversion
kernels                 a kernel with its arrays, and its call for any of these, in blocks, by threads
"""
