# .lcm files to a Java archive. cmake -DLCM_GEN=… -DJAVAC=… -DJAR=… -DLCM_JAR=… -DSOURCES=… -DWORK=… -DOUT=… -P this
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK}/source ${WORK}/classes)
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result ERROR_VARIABLE output OUTPUT_VARIABLE output)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGN} failed:\n${output}")
  endif()
endfunction()
run(${LCM_GEN} -j --jpath ${WORK}/source ${SOURCES})
file(GLOB_RECURSE files ${WORK}/source/*.java)
# Java 8: what the oldest lcm-spy about runs on.
run(${JAVAC} -nowarn --release 8 -cp ${LCM_JAR} -d ${WORK}/classes ${files})
run(${JAR} cf ${OUT} -C ${WORK}/classes .)
