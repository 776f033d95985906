# cortshift_vectorise(TARGET): its loops may use vector registers (no errno, no traps), and every instruction set gives the same bits
# (no contraction). cortshift_flow exports this file, since it is the package that every other one knows.
function(cortshift_vectorise target)
  target_compile_options(${target} PRIVATE -O3 -ffp-contract=off -fno-math-errno -fno-trapping-math)
endfunction()
